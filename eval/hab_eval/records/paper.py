"""Results of the Habitat 2.0 paper."""

from __future__ import annotations

from dataclasses import dataclass

ENV = "HabPick-v1"
PROTOCOLS = {
    "unseen": ("apartment", None, ("val", "test")),
    "seen": ("replicaCAD", "ycb", ("train",)),
}
"""Layouts of the paper -> scene dataset, objects and splits of comparable submissions."""


@dataclass(frozen=True, kw_only=True)
class PaperResult:
    """A success rate of the paper.

    Attributes:
        method: Name in the paper.
        layouts: ``seen`` or ``unseen`` layouts.
        percent: Success rate on Pick, as printed [%].
        source: Table or section.
        agent: Agent of this project that implements the method.
        note: Differences between the two protocols.
    """

    method: str
    layouts: str
    percent: str
    source: str
    agent: str
    note: str


SAME_RULES = "Same skill, horizon, success and failure conditions. "
OTHER_LAYOUTS = (
    "Other layouts: the apartment's validation or test layouts, because the copy of ReplicaCAD "
    "used here has no unseen layouts."
)
SAME_LAYOUTS = "ReplicaCAD's training layouts and YCB objects, as in the paper; other episodes."
SPA_NOTE = " Contact detection and replanning are additions."

RESULTS = (
    PaperResult(
        method="SPA-Priv",
        layouts="unseen",
        percent="80.0",
        source="Table 3",
        agent="hab_spa:spa_priv",
        note=f"{SAME_RULES}{OTHER_LAYOUTS} Straight-line plans and replanning are additions.",
    ),
    PaperResult(
        method="SPA",
        layouts="unseen",
        percent="72.7",
        source="Table 3",
        agent="hab_spa:spa",
        note=f"{SAME_RULES}{OTHER_LAYOUTS}{SPA_NOTE}",
    ),
    PaperResult(
        method="SPA",
        layouts="seen",
        percent="70.2",
        source="Table 3",
        agent="hab_spa:spa",
        note=f"{SAME_RULES}{SAME_LAYOUTS}{SPA_NOTE}",
    ),
    PaperResult(
        method="MonolithicRL, blind",
        layouts="unseen",
        percent="78",
        source="Supplement F.1",
        agent="hab_ppo:pick_blind",
        note=f"{SAME_RULES}{OTHER_LAYOUTS}",
    ),
    PaperResult(
        method="MonolithicRL, depth",
        layouts="unseen",
        percent="86.3",
        source="Table 3",
        agent="hab_ppo:pick_depth",
        note=f"{SAME_RULES}{OTHER_LAYOUTS}",
    ),
)


@dataclass(frozen=True, kw_only=True)
class NotComparable:
    """A result of the paper without a counterpart, and the reason."""

    what: str
    reason: str


NOT_COMPARABLE = (
    NotComparable(
        what="Task success of TP+SPA and TP+SRL (Fig. 5)",
        reason="The paper's agents navigate with a learned policy, and a failed skill ends the "
        "episode. The planners submitted here navigate with an oracle, retry failed skills and "
        "replan. The figure has bars without printed values.",
    ),
    NotComparable(
        what="Pick with unseen objects and unseen receptacles (Table 3)",
        reason="There is no submission with held-out objects or receptacles yet (hab-eval run "
        "--novel objects, --novel receptacles).",
    ),
    NotComparable(
        what="Simulation speed (Table 2)",
        reason="The paper measured a GPU renderer on eight GPUs. Speed is compared with ManiSkill "
        "on the same machine instead; see hab-eval bench.",
    ),
)
