"""Numbers that every skill shares, each with unit and source (S = supplement of Habitat 2.0)."""

from __future__ import annotations

SIM_HZ = 120
"""Physics rate [Hz] (design decision: Habitat's ctrl_freq)."""

CONTROL_HZ = 30
"""Action rate [Hz]: four physics steps for each action."""

GRASP_RADIUS_M = 0.15
"""An object or handle within this distance of the end-effector can be snapped (S E.3)."""

PLACE_RADIUS_M = 0.15
"""An object is at its goal within this distance, whatever its orientation (S G.1)."""

EE_STEP_M = 0.015
"""Largest end-effector displacement in one action (S E.3)."""

JOINT_STEP_RAD = 0.0125
"""Largest joint displacement in one action of the 7-D arm mode (Habitat's joint delta)."""

REST_POSITION_M = (0.5, 0.0, 1.0)
"""Resting position of the end-effector in the base frame (x forward, z up)."""

REST_RADIUS_M = 0.15
"""The end-effector is at rest within this distance of `REST_POSITION_M`."""

BASE_RADIUS_M = 0.3
"""Radius of the disc that stands for Fetch's base on the floor."""

CAMERA_SIZE_PX = 128
CAMERA_HFOV_RAD = 1.5707963267948966
CAMERA_DEPTH_MAX_M = 10.0
"""Depth is clipped here and scaled to [0, 1]."""

SKILL_HORIZON_STEPS = 200
"""Longest episode of every skill but Navigate (S H.2)."""

NAVIGATE_HORIZON_STEPS = 500
"""Longest episode of Navigate (S H.2)."""

TIDY_HOUSE_HORIZON_STEPS = 5000
PREPARE_GROCERIES_HORIZON_STEPS = 4000
SET_TABLE_HORIZON_STEPS = 4500
