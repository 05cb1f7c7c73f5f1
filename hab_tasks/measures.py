"""Named measures and the only mutable episode state.

`Measures` are computed from two consecutive snapshots; `Tracker` remembers what a single snapshot
cannot tell (accumulated force, previous distances, what was held before) and advances exactly once
for each control step.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of one moment; all (N,) unless said otherwise.

    Attributes:
        ee_to_object_m: Distance from the end-effector to the target's centre of mass.
        ee_to_rest_m: Distance from the end-effector to its resting position (base frame).
        ee_to_object_decrease_m: d_{t-1} - d_t of the first; 0 on the first moment (S C).
        ee_to_rest_decrease_m: d_{t-1} - d_t of the second; 0 on the first moment.
        holding_target: The target is in the hand.
        holding_other: Another object is in the hand.
        picked_now: The target was grasped in this step.
        dropped_now: The target left the hand in this step.
        force_n: Contact force C_t on the robot in this step.
        force_total_n: Sum of C_t since the episode began.
        ee_in_base_m: (N, 3) end-effector in the base frame.
    """

    ee_to_object_m: Tensor
    ee_to_rest_m: Tensor
    ee_to_object_decrease_m: Tensor
    ee_to_rest_decrease_m: Tensor
    holding_target: Tensor
    holding_other: Tensor
    picked_now: Tensor
    dropped_now: Tensor
    force_n: Tensor
    force_total_n: Tensor
    ee_in_base_m: Tensor

    def as_dict(self) -> dict[str, Tensor]:
        """Returns the scalar measures by name, for `info`."""
        return {name: getattr(self, name) for name in _SCALARS}


_SCALARS = tuple(f.name for f in fields(Measures) if f.name != "ee_in_base_m")


class Tracker:
    """Advances `Measures` from snapshot to snapshot.

    Attributes:
        measures: The measures of the latest snapshot.
        target: (N,) index of the target object.
    """

    measures: Measures

    def __init__(self, num_envs: int, device: torch.device | str) -> None:
        self.target = torch.zeros(num_envs, dtype=torch.long, device=device)
        self._rest = torch.tensor(REST_POSITION_M, device=device)
        self._started = False

    def begin(self, snapshot: Snapshot, rows: Tensor) -> None:
        """Starts the episodes in `rows` (R,) at `snapshot`; the other rows keep their state."""
        fresh = self._still(snapshot)
        if not self._started:
            self.measures, self._started = fresh, True
            return
        chosen = torch.zeros(len(self.target), dtype=torch.bool, device=self.target.device)
        chosen[rows] = True
        self.measures = select_rows(chosen, fresh, self.measures)

    def advance(self, snapshot: Snapshot) -> None:
        """Takes the next control step's snapshot."""
        last = self.measures
        to_object_m, to_rest_m = self._distances(snapshot)
        holding = snapshot.held == self.target
        self.measures = Measures(
            ee_to_object_m=to_object_m,
            ee_to_rest_m=to_rest_m,
            ee_to_object_decrease_m=last.ee_to_object_m - to_object_m,
            ee_to_rest_decrease_m=last.ee_to_rest_m - to_rest_m,
            holding_target=holding,
            holding_other=(snapshot.held >= 0) & ~holding,
            picked_now=holding & ~last.holding_target,
            dropped_now=last.holding_target & ~holding,
            force_n=snapshot.force_n,
            force_total_n=last.force_total_n + snapshot.force_n,
            ee_in_base_m=snapshot.ee_in_base_m,
        )

    def get_state(self) -> dict[str, Tensor]:
        """Returns everything needed to go on from here, by name, (N, ...)."""
        state = {f.name: getattr(self.measures, f.name).clone() for f in fields(Measures)}
        return {**state, "target": self.target.clone()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores `rows` (R,) from what `get_state` returned for R rows."""
        values = {}
        for f in fields(Measures):
            value = getattr(self.measures, f.name).clone()
            value[rows] = state[f.name].to(value.dtype)
            values[f.name] = value
        self.measures = Measures(**values)
        self.target = self.target.clone()
        self.target[rows] = state["target"].to(torch.long)

    def _still(self, s: Snapshot) -> Measures:
        """Measures of a snapshot that has no predecessor: differences and totals are zero."""
        to_object_m, to_rest_m = self._distances(s)
        holding = s.held == self.target
        return Measures(
            ee_to_object_m=to_object_m,
            ee_to_rest_m=to_rest_m,
            ee_to_object_decrease_m=torch.zeros_like(to_object_m),
            ee_to_rest_decrease_m=torch.zeros_like(to_rest_m),
            holding_target=holding,
            holding_other=(s.held >= 0) & ~holding,
            picked_now=torch.zeros_like(holding),
            dropped_now=torch.zeros_like(holding),
            force_n=s.force_n,
            force_total_n=s.force_n,
            ee_in_base_m=s.ee_in_base_m,
        )

    def _distances(self, s: Snapshot) -> tuple[Tensor, Tensor]:
        gaps = torch.stack((s.object_m - s.ee_m, s.ee_in_base_m - self._rest))
        to_object_m, to_rest_m = torch.linalg.vector_norm(gaps, dim=2).unbind()
        return to_object_m, to_rest_m


def select_rows(chosen: Tensor, new: Measures, old: Measures) -> Measures:
    """Returns `new` in the chosen rows (N,) and `old` elsewhere."""
    values = {}
    for f in fields(Measures):
        a, b = getattr(new, f.name), getattr(old, f.name)
        mask = chosen.view(-1, *([1] * (a.dim() - 1)))
        values[f.name] = torch.where(mask, a, b)
    return Measures(**values)
