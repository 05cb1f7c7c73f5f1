"""The table of planted defects fits the code."""

from defects import DEFECTS, ROOT, misplaced


def test_each_defect_can_be_planted():
    assert misplaced(ROOT) == []
    assert len({defect.name for defect in DEFECTS}) == len(DEFECTS) == 30
    assert sum(defect.tier == "quick" for defect in DEFECTS) >= 27
