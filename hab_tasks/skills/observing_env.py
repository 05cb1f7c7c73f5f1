"""What the agent and a person see of an environment: entries, cameras, noise, lamps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import Camera, CameraConfig
from torch import Tensor

from hab_tasks.arrays import to_tensor
from hab_tasks.errors import OptionError
from hab_tasks.noise import NoiseSource, SensorNoise
from hab_tasks.option_values import flag
from hab_tasks.privileged import Array
from hab_tasks.rendering import resolve_backend, sensor_shader
from hab_tasks.robots.cameras import PLACES, CameraRig, HiddenArm
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.sensors import ARM_QPOS, ObsEntry, observed, scale_depth
from hab_tasks.simulation import check_rows
from hab_tasks.skills.marks import Marks
from hab_tasks.skills.viewpoint import FIELD_OF_VIEW_RAD, FIRST_VIEW, Hit, Viewpoint
from hab_tasks.skills.world import World

RENDER_SIZE_PX = 512
VIEW_SIZE_PX = 256

VIEWS = ("head", "arm")
"""Cameras on the robot that `render_views` shows a person, whatever the agent sees with."""

WITHOUT_IMAGES = ("state", "state_dict", "none")
"""Observation modes that need no renderer."""


class ObservingEnv(BaseEnv):
    """Reads and draws the observations of a `World`, and a person's view of it."""

    observation: ClassVar[tuple[ObsEntry, ...]]
    handle: ClassVar[ObsEntry | None] = None
    """The entry that the option `handle_position` adds, where there is one."""

    cameras: ClassVar[tuple[str, ...]] = ("head", "arm")
    agent: HabFetch  # type: ignore[assignment]
    _world: World
    _noise: NoiseSource | None
    _viewpoint: Viewpoint
    _hides_arm: bool
    _images_on_demand = False
    _views: dict[str, Camera]
    _marks: Marks | None

    def _set_sensors(
        self,
        cameras: Iterable[str] | None,
        size_px: int,
        hfov_rad: float,
        noise: SensorNoise | Mapping[str, float] | None,
    ) -> None:
        """Keeps what the agent sees, checked."""
        self._rig = CameraRig.of(self.cameras if cameras is None else cameras, size_px, hfov_rad)
        self._sensor_noise = SensorNoise.of(noise)

    def _set_entries(self, proprioception: bool, target_frame: str, handle_position: bool) -> None:
        """Keeps what the agent feels and is told, in the form in which each step needs it."""
        flag("proprioception", proprioception)
        flag("handle_position", handle_position)
        entries = observed(self.observation, self.handle, target_frame, handle_position)
        self._felt = [e for e in entries if proprioception and e.proprioceptive]
        self._told = [e for e in entries if not e.proprioceptive]

    def _set_backend(self, backend: str, num_envs: int, options: dict[str, Any]) -> str:
        """Keeps and returns ManiSkill's render_backend.

        Args:
            backend: The option.
            num_envs: Rows of the batch; refused where this machine cannot simulate them.
            options: ManiSkill's own, which say what is drawn, and what simulates.
        """
        check_rows(num_envs, options.get("sim_backend"))
        obs_mode = options.get("obs_mode") or "state"
        images = obs_mode not in WITHOUT_IMAGES
        if images and not self._rig.names:
            valid = f"some of {list(PLACES)} with obs_mode={obs_mode!r}, or obs_mode 'state'"
            raise OptionError("cameras", (), valid)
        drawn = images or options.get("render_mode") is not None
        self._backend = resolve_backend(backend, drawn)
        return self._backend

    # Drawing ---------------------------------------------------------------------------------

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:  # type: ignore[override]
        return CameraConfig(
            uid="render_camera",
            pose=FIRST_VIEW,  # type: ignore[arg-type]  # moved by _aim
            width=RENDER_SIZE_PX,
            height=RENDER_SIZE_PX,
            fov=FIELD_OF_VIEW_RAD,
            near=0.05,
            far=50.0,
            mount=self.agent.link("base_link"),
        )

    def _start_observing(self) -> None:
        """Runs when a new simulation has been built, before its cameras are set up."""
        self._viewpoint, self._views, self._marks = Viewpoint(), {}, None
        noise = self._sensor_noise
        self._noise = None if noise is None else NoiseSource(noise, self.num_envs)
        self.agent.rig = self._rig
        if self._hides_arm and self.scene.can_render():
            self._hidden_objects.append(HiddenArm(self.agent.link))  # type: ignore[arg-type]
        if self.render_mode is not None and self.scene.can_render() and not self.gpu_sim_enabled:
            self._marks = Marks(self.scene)
            self._hidden_objects.append(self._marks)  # type: ignore[arg-type]

    @property
    def _is_lit(self) -> bool:
        # Depth needs no light, and lamps cost a software renderer a quarter of its time.
        return self.scene.can_render() and (self.render_mode is not None or self._wants_colour)

    @property
    def _wants_colour(self) -> bool:
        visual = self.obs_mode_struct.visual
        other = self.obs_mode in ("pointcloud", "sensor_data")
        return other or visual.rgb or visual.normal or visual.albedo

    def _setup_sensors(self, options: dict[str, Any]) -> None:
        self._custom_sensor_configs = sensor_shader(
            self._custom_sensor_configs or {}, self._backend, self._wants_colour
        )
        super()._setup_sensors(options)

    def _load_lighting(self, options: dict[str, Any]) -> None:
        """Leaves out ManiSkill's lamps: the world shows the layout's own."""

    def render_rgb_array(self, camera_name: str | None = None) -> Any:
        """Renders the human-render camera, put where nothing hides the hand, with marks."""
        self._aim()
        image = super().render_rgb_array(camera_name)  # pyright: ignore[reportArgumentType]  # None is its default
        self._hide()
        return image

    def render_all(self) -> Any:
        """Renders the human-render camera and the sensors."""
        self._aim()
        return super().render_all()

    def render_human(self) -> Any:
        """Draws the window, with marks."""
        if self._marks is not None:
            self._marks.place(self._world)
        return super().render_human()

    def render_views(self) -> dict[str, Tensor]:
        """Renders what the robot has before its head and its hand, in colour, for a person.

        It works in every observation mode, and needs a `render_mode`. Not for GPU simulation.

        Returns:
            Name in `VIEWS` -> (N, 256, 256, 3) uint8.
        """
        if not self._views:
            rig = CameraRig(names=VIEWS, size_px=VIEW_SIZE_PX, hfov_rad=self._rig.hfov_rad)
            configs = rig.configs(self.agent.link)
            self._views = {config.uid: Camera(config, self.scene) for config in configs}
        self._hide()
        self.scene.update_render(update_sensors=False, update_human_render_cameras=False)
        views = {}
        for name, camera in self._views.items():
            camera.capture()
            views[name] = camera.get_obs(depth=False, position=False, segmentation=False)["rgb"]
        return views

    def _hide(self) -> None:
        """Hides what only the human-render camera sees; ManiSkill forgets it after one picture."""
        hidden: Any
        for hidden in self._hidden_objects:
            hidden.hide_visual()

    def _aim(self) -> None:
        """Places the marks; moves the human-render camera where something hides the hand."""
        if self.gpu_sim_enabled:
            return
        if self._marks is not None:
            self._marks.place(self._world)
        pose = self._viewpoint.follow(self._world, self._cast_ray)
        if pose is not None:
            for camera in self._human_render_cameras["render_camera"].camera._render_cameras:
                camera.local_pose = pose

    def _cast_ray(self, origin_m: Array, direction: Array, length_m: float) -> Hit | None:
        """Returns the first hit of a ray in the CPU simulation."""
        px: Any = self.scene.px
        hit = px.raycast(origin_m.astype(np.float32), direction.astype(np.float32), length_m)
        return None if hit is None else (float(hit.distance), hit.component.entity.name)

    # Observations ----------------------------------------------------------------------------

    def leave_out_images(self) -> None:
        """Makes observations cheap: from now on they lack the groups that `look` returns.

        Raises:
            OptionError: The observation mode has no such groups.
        """
        if self.obs_mode in WITHOUT_IMAGES or "pointcloud" in self.obs_mode:
            raise OptionError("obs_mode", self.obs_mode, "one with images of cameras, e.g. 'depth'")
        self._images_on_demand = True

    def look(self) -> dict[str, Any]:
        """Renders ``sensor_param`` and ``sensor_data`` of this moment.

        The pictures are those that an observation of this `obs_mode` holds.
        """
        transforms = self.obs_mode != "sensor_data"
        return {
            "sensor_param": self.get_sensor_params(),
            "sensor_data": self._get_obs_sensor_data(transforms),
        }

    def _get_obs_with_sensor_data(
        self, info: dict[str, Any], apply_texture_transforms: bool = True
    ) -> dict[str, Any]:
        if self._images_on_demand:
            return self._get_obs_state_dict(info)
        return super()._get_obs_with_sensor_data(info, apply_texture_transforms)

    def _flatten_raw_obs(self, obs: Any) -> Any:
        """Returns the observation, without groups that are empty, which Gymnasium refuses."""
        flat = super()._flatten_raw_obs(obs)
        if not isinstance(flat, dict):
            return flat
        return {name: group for name, group in flat.items() if len(group)}

    def _get_obs_agent(self) -> dict[str, Tensor]:
        felt = self._values(self._felt)
        if self._noise is not None and ARM_QPOS.name in felt:
            felt[ARM_QPOS.name] = self._noise.joints(felt[ARM_QPOS.name])
        return felt

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Tensor]:
        return self._values(self._told)

    def _values(self, entries: list[ObsEntry]) -> dict[str, Tensor]:
        world = self._world
        now = world.snapshot, world.tracker.measures, world.goals
        return {entry.name: to_tensor(entry.read(*now)) for entry in entries}

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> dict[str, Any]:
        data = super()._get_obs_sensor_data(apply_texture_transforms)
        if self._noise is not None:
            data = self._noise.images(data)
        if self.obs_mode_struct.visual.depth and apply_texture_transforms:
            for images in data.values():
                images["depth"] = scale_depth(images["depth"])
        return data
