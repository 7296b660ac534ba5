"""Independent reader of Gazebo worlds: the documented equations, in Gazebo's frames.

Sources: the SDF specification (inertial, fluid_added_mass, axis), and the class documentation of gz-sim's
Hydrodynamics, Thruster and Buoyancy systems.  Worlds are z-up, links forward, left, up; spatial vectors are
linear first.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np

VELOCITIES, FORCES = "UVWPQR", "xyzkmn"


def cross(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def numbers(element, tag, default=None):
    found = element.find(tag)
    return default if found is None else np.array(found.text.split(), float)


def spatial(mass, at, moments):
    """Return the inertia of a rigid body about the link's origin, (6, 6)."""
    S = cross(at)
    return np.block([[mass * np.eye(3), -mass * S], [mass * S, moments - mass * S @ S]])


def moments_of(inertial):
    xx, xy, xz, yy, yz, zz = (float(element.text) for element in inertial.find("inertia"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def product(a, b):
    """Return a x b, much faster than numpy's function."""
    (p, q, r), (x, y, z) = a.tolist(), b.tolist()
    return np.array([q * z - r * y, r * x - p * z, p * y - q * x])


class World:
    """Content of a world file for its only model."""

    def __init__(self, text: bytes) -> None:
        root = ET.fromstring(text)
        assert (root.tag, root.get("version")) == ("sdf", "1.11")
        world = root.find("world")
        self.gravity = numbers(world, "gravity")
        plugins = {one.get("name"): one for one in world.findall("plugin")}
        density = float(plugins["gz::sim::systems::Buoyancy"].find("uniform_fluid_density").text)
        model = world.find("model")
        base = model.find("link[@name='base_link']")
        self.mass, self.moment, self.body = 0.0, np.zeros(3), np.zeros((6, 6))
        for link in model.findall("link"):
            origin = numbers(link, "pose", np.zeros(6))[:3]
            inertial = link.find("inertial")
            at = origin + numbers(inertial, "pose", np.zeros(6))[:3]
            mass = float(inertial.find("mass").text)
            self.mass += mass
            self.moment += mass * at
            self.body += spatial(mass, at, moments_of(inertial))
        self.added = np.zeros((6, 6))
        for element in base.find("inertial/fluid_added_mass") or ():
            i, j = ("xyzpqr".index(letter) for letter in element.tag)
            self.added[i, j] = self.added[j, i] = float(element.text)
        collision = base.find("collision")
        self.lift = density * numbers(collision, "geometry/box/size").prod() * -self.gravity[2]
        self.center = numbers(collision, "pose")[:3]
        plugins = model.findall("plugin")
        self.thrusters = [self._thruster(model, one) for one in plugins if "Thruster" in one.get("name")]
        (hydro,) = (one for one in plugins if "Hydrodynamics" in one.get("name"))
        assert hydro.find("link_name").text == "base_link"
        assert hydro.find("disable_coriolis").text == hydro.find("disable_added_mass").text == "true"
        self.solver = np.linalg.inv(self.body + self.added)
        self.current = numbers(hydro, "default_current", np.zeros(3))
        self.linear, self.sized, self.plain = np.zeros((6, 6)), np.zeros((6, 6, 6)), np.zeros((6, 6, 6))
        for element in hydro:
            found = re.fullmatch(r"([xyzkmn])([UVWPQR])(abs)?([UVWPQR])?", element.tag)
            if not found:
                continue
            force, first, size, second = found.groups()
            place = FORCES.index(force), VELOCITIES.index(first)
            if second is None:
                self.linear[place] = float(element.text)
            else:
                (self.sized if size else self.plain)[(*place, VELOCITIES.index(second))] = float(element.text)

    @staticmethod
    def _thruster(model, plugin):
        joint = model.find(f"joint[@name='{plugin.find('joint_name').text}']")
        at = numbers(model.find(f"link[@name='{joint.find('child').text}']"), "pose")[:3]
        axis = numbers(joint, "axis/xyz")
        limits = [float(plugin.find(tag).text) for tag in ("min_thrust_cmd", "max_thrust_cmd")]
        return axis / np.linalg.norm(axis), at, limits, numbers(plugin, "deadband", np.zeros(1))[0]

    def wrench(self, newtons):
        """Return the wrench of the thrusters about the origin."""
        tau = np.zeros(6)
        for (axis, at, (low, high), band), thrust in zip(self.thrusters, newtons, strict=True):
            thrust = min(max(thrust, low), high)
            force = axis * (thrust if abs(thrust) >= band else 0.0)
            tau += np.concatenate([force, product(at, force)])
        return tau

    def rates(self, state, thrust, whole_rate=False):
        """Return the rates of position, quaternion (w, x, y, z) and body velocity of the link's origin.

        `whole_rate`: as if the added mass felt the rate of the velocity through the water.
        """
        q, nu = state[3:7], state[7:]
        R = matrix(q)
        v, omega = nu[:3], nu[3:]
        drift = R.T @ self.current
        through = nu - np.r_[drift, np.zeros(3)]
        tau = thrust - coriolis(self.body, nu) - coriolis(self.added, nu)
        tau += coriolis(self.added, nu) - coriolis(self.added, through)
        sizes = np.abs(through)
        D = self.linear + self.sized @ sizes + self.plain @ through
        tau += D @ through
        if whole_rate:
            tau -= self.added[:, :3] @ product(omega, drift)
        down = R.T @ self.gravity
        up = -down / np.linalg.norm(self.gravity) * self.lift
        tau[:3] += self.mass * down + up
        tau[3:] += product(self.moment, down) + product(self.center, up)
        spin = 0.5 * np.array(
            [
                -q[1:] @ omega,
                q[0] * omega[0] + q[2] * omega[2] - q[3] * omega[1],
                q[0] * omega[1] + q[3] * omega[0] - q[1] * omega[2],
                q[0] * omega[2] + q[1] * omega[1] - q[2] * omega[0],
            ]
        )
        return np.concatenate([R @ v, spin, self.solver @ tau])

    def fly(self, newtons, dt, **options):
        """Return the motion (N, 12), NED and FRD, under thrusts (N, n) held for a row each, from rest."""
        state, h = np.r_[np.zeros(3), 1.0, np.zeros(9)], dt
        rows = [state]
        for row in newtons[:-1]:
            thrust = self.wrench(row)
            a = self.rates(state, thrust, **options)
            b = self.rates(state + 0.5 * h * a, thrust, **options)
            c = self.rates(state + 0.5 * h * b, thrust, **options)
            d = self.rates(state + h * c, thrust, **options)
            state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            state[3:7] /= np.linalg.norm(state[3:7])
            rows.append(state)
        return np.array([in_ned(one) for one in rows])


def coriolis(inertia, nu):
    """Return omega x p and omega x h + v x p of the momentum [p; h] (Kirchhoff)."""
    momentum = inertia @ nu
    p, h = momentum[:3], momentum[3:]
    return np.concatenate([product(nu[3:], p), product(nu[3:], h) + product(nu[:3], p)])


def matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def in_ned(state):
    """Return pose and velocity after half a turn of world and body about x."""
    flip = np.diag([1.0, -1.0, -1.0])
    R = flip @ matrix(state[3:7]) @ flip
    angles = [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1, 1)), np.arctan2(R[1, 0], R[0, 0])]
    return np.concatenate([flip @ state[:3], angles, flip @ state[7:10], flip @ state[10:]])
