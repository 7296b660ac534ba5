"""Diagnosis: the physical effect that a vehicle file lacks, with a confidence.

Data pass through these modules, in the order of `pipeline.diagnose_log`:

| step | module | result |
|---|---|---|
| clean the log, audit the thrusters | `log_faults`, `mounting` | `Preprocessed` |
| learn the hull force before a change | `core.residual.hull`, `completing` | `Hull` |
| cut shots, refit the file | `baseline`, `model` | `Baseline` |
| choose effects by likelihood | `search`, `by_likelihood` | `Outcome` |
| or one effect by evidence | `transfer`, `by_evidence` | `Named` |
| or changes with the hull force held | `contenders`, `by_change`, `onset` | `Changes` |
| state confidences and doubts | `confidence`, `doubts`, `closed_loop` | `Finding` |
| name what remains or is not shown | `unexplained`, `identifiability` | `Finding` |
| check findings on held-out data | `held_out` | `Prediction` |
| state the answer in words | `status` | `Status` |

Likelihood, changes and discovery share the loop of `selection`: add the best candidate while it belongs to
the model.  `settings` has the numbers of all steps.

Arguments of these names mean the same here, in discovery and in explanation:

| name | meaning |
|---|---|
| `vehicle`, `file` | vehicle, often as in its file; file whose values are prior knowledge |
| `log` | preprocessed recording, with the tests of its sensors |
| `baseline` | vehicle file with its effects refitted, and the shots of the recording |
| `outcome`, `chosen` | result of a search; effects that joined the model so far |
| `known` | fits by effect that compete with new ones, or priors of the components |
| `hull` | hull-force model from a recording before a change; None without one |
| `further` | whether the vehicle has changes already, so that the next one must be larger |
| `in_vain` | whether an earlier search stayed far from the noise: above FAR_FROM_NOISE, transfer then ranks |
| `reach` | positions [m] and times [s] of the recording, (N, 4), among which anchors are sought |
| `iterations`, `share` | maximum number of steps of a fit; least relative reduction of the cost by a step |
| `wiring` | order and signs of the command columns; None for those of the vehicle file |
| `dt` | sample time of the recording [s] |
| `progress` | called with a short text and the share of the work done |
| `provisional`, `told` | called once, with the best candidate after the first fits |
"""
