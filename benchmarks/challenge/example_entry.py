"""Example of an entry that uses nothing of hydro: a linear model of each axis, by numpy and polars.

    python example_entry.py FOLDER/cases FOLDER/entries/example

The acceleration of an axis is a linear function of velocities, their signed squares, the world's directions
in the body frame, and signed squares of the commands, which follow with a lag.  Least squares fits it to the
log.  The script names a weak thruster if the coefficients of one thruster alone fell since the earlier log;
otherwise it names nothing.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import polars as pl

VELOCITY = ["u", "v", "w", "p", "q", "r"]
LAG = 0.15  # s, of the thrusters
FALLEN, ALIKE = 0.75, 0.9  # share of its thrust that a weak thruster keeps at most, and the others at least
RIDGE = 1e-3  # share of each regressor's sum of squares


def rotation(phi: np.ndarray, theta: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Return the rotation from the body to the world, (N, 3, 3), from ZYX Euler angles."""
    (a, b, c), (d, e, f) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    rows = [
        [b * c, d * e * c - a * f, a * e * c + d * f],
        [b * f, d * e * f + a * c, a * e * f - d * c],
        [-e, d * b, a * b],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def thrust(raw: pl.DataFrame, dt: float) -> np.ndarray:
    """Return the lagged commands of n thrusters, squared with their sign, (N, n); sessions start at rest."""
    names = [name for name in raw.columns if name.startswith("cmd_")]
    keep, parts = np.exp(-dt / LAG), []
    for part in raw.partition_by("session", maintain_order=True):
        commands = part.select(names).to_numpy().astype(float)
        speed = np.zeros_like(commands)
        for k in range(1, len(speed)):
            speed[k] = commands[k - 1] + keep * (speed[k - 1] - commands[k - 1])
        parts.append(np.abs(speed) * speed)
    return np.concatenate(parts)


def regressors(nu: np.ndarray, R: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the regressors of an acceleration, (N, 6 + 6 + 9 + n).

    They are velocities, their signed squares, the rotation matrix and signed squares of the commands.
    """
    return np.hstack([nu, np.abs(nu) * nu, R.reshape(-1, 9), force])


def fitted(raw: pl.DataFrame, dt: float) -> np.ndarray:
    """Return the coefficients of all axes, (regressors, 6)."""
    step, xs, ys = round(0.2 / dt), [], []
    force = thrust(raw, dt)
    numbered = raw.with_row_index("row")
    for part in numbered.partition_by("session", maintain_order=True):
        nu = part.select(VELOCITY).to_numpy().astype(float)
        R = rotation(*part.select("phi", "theta", "psi").to_numpy().astype(float).T)
        x = regressors(nu, R, force[part["row"].to_numpy()])
        mean = np.cumsum(np.vstack([np.zeros(x.shape[1]), x]), axis=0)
        xs.append((mean[step:-1] - mean[: -step - 1])[::5] / step)
        ys.append((nu[step:] - nu[:-step])[::5] / (step * dt))
    x, y = np.vstack(xs), np.vstack(ys)
    size = np.sqrt((x**2).sum(axis=0))
    ridge = np.diag(RIDGE * size**2 + 1e-12)
    return np.linalg.solve(x.T @ x + ridge, x.T @ y)


def weak(now: np.ndarray, then: np.ndarray, thrusters: int) -> list[dict[str, object]]:
    """Return the weak thruster as a named effect, by the change of its coefficients; empty if unclear.

    Args:
        now: Coefficients fitted to the log (regressors, 6).
        then: Coefficients fitted to the earlier log (regressors, 6).
        thrusters: Number of thrusters.
    """
    rows = slice(len(now) - thrusters, None)
    ratio = (now[rows] * then[rows]).sum(axis=1) / (then[rows] ** 2).sum(axis=1)
    order = np.argsort(ratio)
    if ratio[order[0]] > FALLEN or ratio[order[1]] < ALIKE:
        return []
    gains = [float(ratio[i] - 1.0) if i == order[0] else 0.0 for i in range(thrusters)]
    return [{"name": "thruster_gain", "confidence": 0.7, "parameters": {"g": gains}}]


def predicted(windows: pl.DataFrame, model: np.ndarray, facts: dict[str, float]) -> pl.DataFrame:
    """Return the predicted velocities in the windows, by steps of Euler's method."""
    dt = float(windows["t"][1] - windows["t"][0])
    first, last, step = (round(facts[name] / dt) for name in ("lead", "ahead", "every"))
    force, parts, begin = thrust(windows, dt), [], 0
    for part in windows.partition_by("session", maintain_order=True):
        nu = part.select(VELOCITY).to_numpy().astype(float)[first]
        R = rotation(*part.select("phi", "theta", "psi").to_numpy().astype(float)[first : first + 1].T)
        rows = []
        for k in range(1, last + 1):
            x = regressors(nu[None], R, force[begin + first + k - 1][None])
            p, q, r = nu[3:] * dt
            R = R @ (np.eye(3) + np.array([[0.0, -r, q], [r, 0.0, -p], [-q, p, 0.0]]))
            nu = np.clip(nu + dt * (x @ model)[0], -50.0, 50.0)
            if k % step == 0:
                rows.append([facts["lead"] + k * dt, *nu.tolist()])
        table = pl.DataFrame(rows, schema=["t", *VELOCITY], orient="row")
        parts.append(table.insert_column(0, part["session"].head(table.height)))
        begin += part.height
    return pl.concat(parts)


def main(cases: Path, entry: Path) -> None:
    """Answer all cases."""
    for there in sorted(path.parent for path in cases.glob("*/case.json")):
        facts = json.loads((there / "case.json").read_text())
        log = pl.read_parquet(there / "log.parquet")
        dt = float(log["t"][1] - log["t"][0])
        begun = time.process_time()
        model = fitted(log, dt)
        effects: list[dict[str, object]] = []
        if facts["before"]:
            then = fitted(pl.read_parquet(there / "before.parquet"), dt)
            effects = weak(model, then, facts["thrusters"])
        table = predicted(pl.read_parquet(there / "heldout.parquet"), model, facts)
        seconds = time.process_time() - begun
        out = entry / there.name
        out.mkdir(parents=True, exist_ok=True)
        table.write_parquet(out / "prediction.parquet")
        (out / "answer.json").write_text(json.dumps({"effects": effects, "seconds": seconds}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
