"""Constants shared by all skills, with unit and source (S = supplement of Habitat 2.0)."""

from __future__ import annotations

SIM_HZ = 120
"""Physics rate [Hz] (design decision: Habitat's ctrl_freq)."""

CONTROL_HZ = 30
"""Action rate [Hz]."""

PHYSICS_STEPS = SIM_HZ // CONTROL_HZ
"""Physics steps of one action."""

GRASP_RADIUS_M = 0.15
"""Maximum distance of the end-effector to a snapped object or handle (S E.3)."""

PLACE_RADIUS_M = 0.15
"""Maximum distance of a placed object to its goal, in any orientation (S G.1)."""

REST_SPEED_M_S = 0.05
"""Maximum speed of a placed object ..."""

REST_STEPS = 10
"""... in each of this many actions since it left the hand."""

EE_STEP_M = 0.015
"""Maximum end-effector displacement per action (S E.3)."""

JOINT_STEP_RAD = 0.0125
"""Maximum joint displacement per action of the 7-D arm mode (Habitat's joint delta)."""

TARGET_STEP_RAD = 0.08
"""Maximum change per action of absolute joint targets and states, 2.4 rad/s; the joints of a real
Fetch reach 1.3 to 2.3 rad/s, and the drives follow more."""

REST_POSITION_M = (0.5, 0.0, 1.0)
"""Resting position of the end-effector in the base frame (x forward, z up)."""

REST_RADIUS_M = 0.15
"""Maximum distance of a resting end-effector to `REST_POSITION_M`."""

BASE_RADIUS_M = 0.3
"""Radius of the disc that models the robot's base on the floor."""

CAMERA_SIZE_PX = 128
CAMERA_HFOV_RAD = 1.5707963267948966
CAMERA_DEPTH_MAX_M = 10.0
"""Depth is clipped here and scaled to [0, 1]."""

SKILL_HORIZON_STEPS = 200
"""Horizon of every skill except Navigate (S H.2)."""

NAVIGATE_HORIZON_STEPS = 500
"""Horizon of Navigate (S H.2)."""
