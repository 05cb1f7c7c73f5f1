"""Observations and rendering of an environment: entries, cameras, noise, lighting."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import Camera, CameraConfig
from torch import Tensor

from hab_tasks.arrays import to_tensor
from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.engine.inherited_options import WITHOUT_IMAGES, ImageSource, choose_source
from hab_tasks.engine.noise import NoiseSource
from hab_tasks.engine.perturbation import as_specified, displace
from hab_tasks.engine.ray_sensors import RaySensors
from hab_tasks.engine.rows import read_entries
from hab_tasks.engine.sensors import ObsEntry, observed, scale_depth
from hab_tasks.engine.viewpoint import FIELD_OF_VIEW_RAD, FIRST_VIEW, Hit, Marks, Viewpoint
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.instructions import FIXED, Words, check_wording
from hab_tasks.option_values import flag
from hab_tasks.privileged import Array
from hab_tasks.rendering import sensor_shader
from hab_tasks.robots.cameras import CameraRig, HiddenArm, new_camera, split_sensor_configs
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.simulator import cameras_by_name

RENDER_SIZE_PX = 512
VIEW_SIZE_PX = 256

DEPTH_UNITS = ("m", "mm")

VIEWS = ("head", "arm")
"""Robot cameras rendered by `render_views`, independent of the agent's cameras."""


class ObservingEnv(BaseEnv):
    """Observations and human rendering of a `simulation` of episodes."""

    observation: ClassVar[tuple[ObsEntry, ...]]
    handle: ClassVar[ObsEntry | None] = None
    """Entry added by the option `handle_position`; None without one."""

    cameras: ClassVar[tuple[str, ...]] = ("head", "arm")
    agent: MobileManipulator  # type: ignore[assignment]
    robot: RobotSpec
    simulation: EpisodeSimulation
    _viewpoint: Viewpoint
    _hides_arm: bool
    _wording: str
    _images_on_demand = False
    _source: ImageSource
    _rays: RaySensors | None
    _ray_cameras: list[CameraConfig]
    _views: dict[str, Camera]
    _marks: Marks | None

    def _set_sensors(
        self, cameras: Iterable[str] | None, size_px: int, hfov_rad: float, invisible_arm: bool
    ) -> None:
        """Validates and stores the camera options."""
        self._rig = CameraRig.of(
            self.robot, self.cameras if cameras is None else cameras, size_px, hfov_rad
        )
        self._hides_arm = flag("invisible_arm", invisible_arm)
        self._new_cameras: dict[str, dict[str, Any]] = {}

    def _set_told(
        self,
        proprioception: bool,
        target_frame: str,
        handle_position: bool,
        targets: str,
        instructions: str,
        depth: str,
    ) -> None:
        """Selects state entries, the wording of instructions, and the unit of depth images."""
        self._wording = check_wording(instructions)
        if depth not in DEPTH_UNITS:
            raise UnknownNameError("depth", depth, DEPTH_UNITS)
        self._scales_depth = depth == "m"
        flag("proprioception", proprioception)
        flag("handle_position", handle_position)
        options = target_frame, handle_position, targets
        entries = observed(self.observation, self.handle, self.robot, *options)
        self._felt = [e for e in entries if proprioception and e.proprioceptive]
        self._told = [e for e in entries if not e.proprioceptive]

    def _set_backend(self, backend: str, options: dict[str, Any]) -> str:
        """Stores and returns ManiSkill's render_backend, chosen by ours and ManiSkill's options."""
        obs_mode = options.get("obs_mode") or "state"
        images = obs_mode not in WITHOUT_IMAGES
        if images and not self._rig.names and not options.get("sensor_configs"):
            names = list(self.robot.cameras)
            valid = f"some of {names} with obs_mode={obs_mode!r}, or obs_mode 'state'"
            raise OptionError.of_value("cameras", (), valid)
        self._source = choose_source(backend, options)
        return self._source.renderer

    # Rendering -------------------------------------------------------------------------------

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
            mount=self.agent.base_link,
        )

    def _start_observing(self) -> None:
        """Hook after a new simulation was built, before its cameras are set up."""
        self._viewpoint, self._views, self._marks = Viewpoint(), {}, None
        self._mount_cameras()
        if self._hides_arm and self.scene.can_render():
            self._hidden_objects.append(HiddenArm(self.robot, self.agent.link))  # type: ignore[arg-type]
        if self.render_mode is not None and self.scene.can_render():
            self._marks = Marks(self.scene)
            self._hidden_objects.append(self._marks)  # type: ignore[arg-type]

    def _displace_cameras(self) -> None:
        """Displaces the cameras at the start of an episode, if a perturbation says so."""
        simulation = self.simulation
        if simulation.perturbation.moves_cameras:
            displace(self._sensors, simulation.perturbation, simulation.episode.seed)

    def _mount_cameras(self) -> None:
        """Gives the cameras of class, robot and options to the robot, or to rays."""
        rig, link = self._rig, self.agent.link
        of_class = cameras_by_name(self._default_sensor_configs)
        # Without new cameras, which ManiSkill would reject; later simulations have them, too.
        self._custom_sensor_configs, new = split_sensor_configs(
            self._custom_sensor_configs, (*of_class, *rig.names)
        )
        self._new_cameras |= new
        added = [new_camera(*named, rig, link) for named in self._new_cameras.items()]
        self._ray_cameras = [*of_class.values(), *rig.configs(link), *added]
        # With rays, the renderer of a `render_mode` has no sensors.
        rendered = (CameraRig(), []) if self._source.casts_rays else (rig, added)
        self.agent.rig, self.agent.new_cameras = rendered

    @property
    def _is_lit(self) -> bool:
        # Depth needs no light; lamps take a quarter of a software renderer's time.
        return self.scene.can_render() and (self.render_mode is not None or self._wants_colour)

    @property
    def _wants_colour(self) -> bool:
        visual = self.obs_mode_struct.visual
        other = self.obs_mode in ("pointcloud", "sensor_data")
        return other or visual.rgb or visual.normal or visual.albedo

    def _setup_sensors(self, options: dict[str, Any]) -> None:
        changes: Any = self._custom_sensor_configs
        source = self._source
        self._custom_sensor_configs = (
            {} if source.casts_rays else sensor_shader(changes, source.renderer, self._wants_colour)
        )
        super()._setup_sensors(options)
        self._custom_sensor_configs = changes

    def _after_reconfigure(self, options: dict[str, Any]) -> None:
        self._rays = None
        if self._source.casts_rays:
            changes: Any = self._custom_sensor_configs
            self._rays = RaySensors(
                self.simulation, self.agent, self._ray_cameras, changes, self._hides_arm
            )
            self._sensors = self.scene.sensors = dict(self._rays.cameras)

    def _load_lighting(self, options: dict[str, Any]) -> None:
        """Disables ManiSkill's lamps; the layout has its own."""

    def render(self) -> Any:
        """Renders as `render_mode` says; images are on the simulation's device."""
        shown = super().render()
        return shown.to(self.device) if isinstance(shown, Tensor) else shown

    def render_rgb_array(self, camera_name: str | None = None) -> Any:
        """Renders the human-render camera, with marks, from where the hand is visible."""
        self._aim()
        image = super().render_rgb_array(camera_name)  # pyright: ignore[reportArgumentType]  # None is its default
        self._hide()
        return image

    def render_all(self) -> Any:
        """Renders the human-render camera and the sensors."""
        self._aim()
        return super().render_all()

    def render_human(self) -> Any:
        """Renders the viewer window, with marks."""
        if self._marks is not None:
            self._marks.place(self.simulation)
        return super().render_human()

    def render_views(self) -> dict[str, Tensor]:
        """Renders the robot's head and arm cameras in colour for humans.

        Works in every observation mode, but requires a `render_mode`.

        Returns:
            Name in `VIEWS` -> (N, 256, 256, 3) uint8.
        """
        if not self._views:
            rig = CameraRig.of(self.robot, VIEWS, VIEW_SIZE_PX, self._rig.hfov_rad)
            configs = rig.configs(self.agent.link)
            self._views = {config.uid: Camera(config, self.scene) for config in configs}
        self._hide()
        self.scene.update_render(update_sensors=False, update_human_render_cameras=False)
        views = {}
        for name, camera in self._views.items():
            camera.capture()
            images = camera.get_obs(depth=False, position=False, segmentation=False)
            views[name] = images["rgb"].to(self.device)
        return views

    def hand_and_force(self) -> str:
        """Returns the object in the hand and the accumulated contact force, for captions."""
        simulation = self.simulation
        force_n = float(simulation.rows.measures.force_total_n[simulation.row])
        return f"holds {simulation.privileged().held or 'no object'}, force {force_n:.0f} N"

    def _hide(self) -> None:
        """Hides human-only visuals from sensors; ManiSkill resets this after every image."""
        hidden: Any
        for hidden in self._hidden_objects:
            hidden.hide_visual()

    def _aim(self) -> None:
        """Places the marks; moves the human-render camera if the hand is occluded."""
        if self._marks is not None:
            self._marks.place(self.simulation)
        pose = self._viewpoint.follow(self.simulation, self._cast_ray)
        if pose is not None:
            for camera in self._human_render_cameras["render_camera"].camera._render_cameras:
                camera.local_pose = pose

    def _cast_ray(self, origin_m: Array, direction: Array, length_m: float) -> Hit | None:
        """Returns the first hit of a ray."""
        px: Any = self.scene.px
        hit = px.raycast(origin_m.astype(np.float32), direction.astype(np.float32), length_m)
        return None if hit is None else (float(hit.distance), hit.component.entity.name)

    # Observations ----------------------------------------------------------------------------

    @property
    def words(self) -> Words:
        """Wording of the instructions of the current episode."""
        if self._wording == "fixed":
            return FIXED
        held_out = self.simulation.source.split == "test"
        return Words(seed=self.simulation.episode.seed, held_out=held_out)

    @property
    def entries(self) -> tuple[ObsEntry, ...]:
        """Entries of the state observation, those of ``agent`` first."""
        return (*self._felt, *self._told)

    @property
    def noise(self) -> NoiseSource | None:
        """Noise of the sensors, if any."""
        return self.simulation.noise

    def leave_out_images(self) -> None:
        """Stops rendering images in observations; `look` renders them on demand.

        Raises:
            OptionError: The observation mode has no images.
        """
        if self.obs_mode in WITHOUT_IMAGES or "pointcloud" in self.obs_mode:
            raise OptionError.of_value(
                "obs_mode", self.obs_mode, "one with images of cameras, e.g. 'depth'"
            )
        self._images_on_demand = True

    def look(self) -> dict[str, Any]:
        """Renders the current ``sensor_param`` and ``sensor_data``.

        The images are those of an observation in this `obs_mode`.
        """
        transforms = self.obs_mode != "sensor_data"
        return {
            "sensor_param": self.get_sensor_params(),
            "sensor_data": self._get_obs_sensor_data(transforms),
        }

    def get_sensor_params(self) -> dict[str, dict[str, Tensor]]:
        """Returns ``sensor_param``, which does not tell how a perturbation displaces cameras."""
        params = super().get_sensor_params()
        moved = self.simulation.perturbation.moves_cameras
        return as_specified(params, self._sensors) if moved else params

    def _get_obs_with_sensor_data(
        self, info: dict[str, Any], apply_texture_transforms: bool = True
    ) -> dict[str, Any]:
        if self._images_on_demand:
            return self._get_obs_state_dict(info)
        return super()._get_obs_with_sensor_data(info, apply_texture_transforms)

    def _flatten_raw_obs(self, obs: Any) -> Any:
        """Returns the observation without empty groups, which Gymnasium rejects."""
        flat = super()._flatten_raw_obs(obs)
        if not isinstance(flat, dict):
            return flat
        return {name: group for name, group in flat.items() if len(group)}

    def _get_obs_agent(self) -> dict[str, Tensor]:
        return self._values(self._felt)

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Tensor]:
        return self._values(self._told)

    def _values(self, entries: list[ObsEntry]) -> dict[str, Tensor]:
        values = read_entries(entries, self.simulation.rows)
        row = self.simulation.row
        return {name: to_tensor(value[row : row + 1]) for name, value in values.items()}

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> dict[str, Any]:
        if self._rays is not None:
            data = self._rays.images(self.obs_mode_struct.visual)
        else:
            data = super()._get_obs_sensor_data(apply_texture_transforms)
            # In CPU simulation, ManiSkill leaves images where a GPU rendered them.
            for images in data.values():
                images |= {name: image.to(self.device) for name, image in images.items()}
        if self.noise is not None:
            data = self.noise.images(data)
        if self._scales_depth and self.obs_mode_struct.visual.depth and apply_texture_transforms:
            for images in data.values():
                images["depth"] = scale_depth(images["depth"])
        return data
