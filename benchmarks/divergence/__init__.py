"""Study of the paper's claim that reinforcement learning with R_MLP diverges in all runs (V-C).

One factor at a time is changed from a stated centre, and some pairs of factors (`cells.CELLS`).  The centre
has 20 minutes of Stonefish data (the bundled sample), labels without noise, accelerations as inputs, and a
lead of 0.  Protocol and conditioning are the paper's, with beta as the weight of the new value.  Each cell
has R_MLP and R_PhysFeat.  A seed, 0 to 4, determines the weights, the noise of the data and the training.

Definitions, fixed before the runs:

* Open loop, explosion: in any flight of the replay, of random commands or of full thrust, the state is not
  finite, or the speed exceeds 5 m/s (`settings.overspeed`).  The recordings reach 1.9 m/s.
* Open loop, energy: in any flight without thrust, the mechanical energy exceeds its value at the start by
  more than 5 % of the kinetic energy at the start.  Water at rest cannot add energy.  Flights start at the
  velocities of a recording.  Flights that start at twice these velocities, which exceed the data, were added
  when the first 33 rows showed no gain at the recorded ones.
* SAC: the three kinds of `hydro.rl.training.divergence`: numerical, critic, success.  All trainings have the
  same budget; no examination ends one early, so that a late divergence is seen.
"""
