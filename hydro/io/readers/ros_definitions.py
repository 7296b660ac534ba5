"""Message types that vehicles log and no ROS distribution has: names and types of their fields.

A recording of ROS 2 before Iron does not describe its types.  If a type has changed, all versions are listed,
the newest first; the reader uses the first that fits a topic's messages (`versions.Versions`).
"""

from __future__ import annotations

_HEAD = "std_msgs/Header header"
_PX4 = "uint64 timestamp"
_SAMPLED = f"{_PX4}; uint64 timestamp_sample"
_LOCAL = (
    f"{_SAMPLED}; bool xy_valid; bool z_valid; bool v_xy_valid; bool v_z_valid; float32 x; float32 y; "
    "float32 z; float32[2] delta_xy; uint8 xy_reset_counter; float32 delta_z; uint8 z_reset_counter; "
    "float32 vx; float32 vy; float32 vz; float32 z_deriv; float32[2] delta_vxy; uint8 vxy_reset_counter; "
    "float32 delta_vz; uint8 vz_reset_counter; float32 ax; float32 ay; float32 az; float32 heading; "
)
_GLOBAL = (
    "bool xy_global; bool z_global; uint64 ref_timestamp; float64 ref_lat; float64 ref_lon; float32 ref_alt; "
)
_UNAIDED = "float32 heading_var; float32 unaided_heading; "
_TURNED = "float32 delta_heading; uint8 heading_reset_counter; bool heading_good_for_control; "
_BOTTOM = "float32 dist_bottom; bool dist_bottom_valid; uint8 dist_bottom_sensor_bitfield; "
_ERRORS = "float32 eph; float32 epv; float32 evh; float32 evv; "
_LIMITS = "float32 vxy_max; float32 vz_max; float32 hagl_min; float32 hagl_max"

_COMPACT: dict[str, tuple[str, ...]] = {
    # MAVROS
    "mavros_msgs/msg/State": (
        f"{_HEAD}; bool connected; bool armed; bool guided; bool manual_input; string mode; "
        "uint8 system_status",
    ),
    "mavros_msgs/msg/RCOut": (f"{_HEAD}; uint16[] channels",),
    "mavros_msgs/msg/RCIn": (f"{_HEAD}; uint8 rssi; uint16[] channels",),
    "mavros_msgs/msg/OverrideRCIn": ("uint16[18] channels", "uint16[] channels", "uint16[8] channels"),
    "mavros_msgs/msg/ManualControl": (
        f"{_HEAD}; float32 x; float32 y; float32 z; float32 r; uint16 buttons; uint16 buttons2; "
        "uint8 enabled_extensions; float32 s; float32 t; float32 aux1; float32 aux2; float32 aux3; "
        "float32 aux4; float32 aux5; float32 aux6",
        f"{_HEAD}; float32 x; float32 y; float32 z; float32 r; uint16 buttons",
    ),
    "mavros_msgs/msg/ActuatorControl": (f"{_HEAD}; uint8 group_mix; float32[8] controls",),
    "mavros_msgs/msg/VfrHud": (
        f"{_HEAD}; float32 airspeed; float32 groundspeed; int16 heading; float32 throttle; float32 altitude; "
        "float32 climb",
    ),
    "mavros_msgs/msg/Altitude": (
        f"{_HEAD}; float32 monotonic; float32 amsl; float32 local; float32 relative; float32 terrain; "
        "float32 bottom_clearance",
    ),
    "mavros_msgs/msg/AttitudeTarget": (
        f"{_HEAD}; uint8 type_mask; geometry_msgs/Quaternion orientation; geometry_msgs/Vector3 body_rate; "
        "float32 thrust",
    ),
    "mavros_msgs/msg/PositionTarget": (
        f"{_HEAD}; uint8 coordinate_frame; uint16 type_mask; geometry_msgs/Point position; "
        "geometry_msgs/Vector3 velocity; geometry_msgs/Vector3 acceleration_or_force; float32 yaw; "
        "float32 yaw_rate",
    ),
    # PX4
    "px4_msgs/msg/ActuatorMotors": (
        f"{_SAMPLED}; uint16 reversible_flags; float32[12] control",
        f"{_SAMPLED}; uint16 reversible_flags; float32[8] control",
    ),
    "px4_msgs/msg/ActuatorServos": (f"{_SAMPLED}; float32[15] control", f"{_SAMPLED}; float32[8] control"),
    "px4_msgs/msg/ActuatorOutputs": (f"{_PX4}; uint32 noutputs; float32[16] output",),
    "px4_msgs/msg/ActuatorArmed": (
        f"{_PX4}; bool armed; bool prearmed; bool ready_to_arm; bool lockdown; bool kill; bool termination; "
        "bool in_esc_calibration_mode",
    ),
    "px4_msgs/msg/VehicleThrustSetpoint": (f"{_SAMPLED}; float32[3] xyz",),
    "px4_msgs/msg/VehicleTorqueSetpoint": (f"{_SAMPLED}; float32[3] xyz",),
    "px4_msgs/msg/VehicleAttitude": (
        f"{_SAMPLED}; float32[4] q; float32[4] delta_q_reset; uint8 quat_reset_counter",
    ),
    "px4_msgs/msg/VehicleAngularVelocity": (
        f"{_SAMPLED}; float32[3] xyz; float32[3] xyz_derivative",
        f"{_SAMPLED}; float32[3] xyz",
    ),
    "px4_msgs/msg/VehicleOdometry": (
        f"{_SAMPLED}; uint8 pose_frame; float32[3] position; float32[4] q; uint8 velocity_frame; "
        "float32[3] velocity; float32[3] angular_velocity; float32[3] position_variance; "
        "float32[3] orientation_variance; float32[3] velocity_variance; uint8 reset_counter; int8 quality",
    ),
    "px4_msgs/msg/VehicleLocalPosition": (
        f"{_LOCAL}{_UNAIDED}{_TURNED}float32 tilt_var; {_GLOBAL}bool dist_bottom_valid; float32 dist_bottom; "
        "float32 dist_bottom_var; float32 delta_dist_bottom; uint8 dist_bottom_reset_counter; "
        f"uint8 dist_bottom_sensor_bitfield; {_ERRORS}bool dead_reckoning; {_LIMITS}_z; float32 hagl_max_xy",
        f"{_LOCAL}{_UNAIDED}{_TURNED}float32 tilt_var; {_GLOBAL}{_BOTTOM}{_ERRORS}"
        f"bool dead_reckoning; {_LIMITS}",
        f"{_LOCAL}{_TURNED}{_GLOBAL}{_BOTTOM}{_ERRORS}bool dead_reckoning; {_LIMITS}",
        f"{_LOCAL}{_TURNED}{_GLOBAL}{_BOTTOM}{_ERRORS}{_LIMITS}",
    ),
    # DVL
    "marine_acoustic_msgs/msg/Dvl": (
        f"{_HEAD}; uint8 velocity_mode; uint8 dvl_type; geometry_msgs/Vector3 velocity; "
        "float64[9] velocity_covar; float64 altitude; float64 course_gnd; float64 speed_gnd; "
        "uint8 num_good_beams; float32 sound_speed; bool beam_ranges_valid; "
        "bool beam_velocities_valid; geometry_msgs/Vector3[4] beam_unit_vec; "
        "float64[4] range; float32[4] range_covar; float32[4] beam_quality; float32[4] beam_velocity; "
        "float32[4] beam_velocity_covar",
    ),
}

BUILT_IN = {kind: tuple(text.replace("; ", "\n") for text in texts) for kind, texts in _COMPACT.items()}
"""Definitions of each type in the form of `.msg` files, the newest version first."""
