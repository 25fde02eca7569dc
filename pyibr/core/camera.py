"""The camera that every part of pyibr shares.

Axes are OpenCV's: x right, y down, z forward. Pixel centres lie at integers: the centre of the top left
pixel is (0, 0), the image reaches from -0.5 to width - 0.5. Depth is planar: the z of a point in the
camera's frame. A lens moves what a pinhole would see; K turns where the lens sees it into pixels.
"""

from __future__ import annotations

from functools import cached_property, partial
from os import PathLike
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core import conventions
from pyibr.core.camera_json import camera_arguments, camera_entries, read_json, write_json
from pyibr.core.checks import (
    Float64,
    checked_bool,
    checked_intrinsics,
    checked_pose,
    checked_size,
    describe,
    instance_of,
    numbers,
    one_of,
    positive,
    read_only,
)
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.lens import Lens

Projection = Literal["perspective", "orthographic"]


class Camera:
    """Pose and projection of an image: the map between its pixels and rays of the world. Immutable.

    Parameters
    ----------
    K : array_like (3, 3)
        [[fx, s, cx], [0, fy, cy], [0, 0, 1]], fx, fy > 0. Perspective: in pixels, pixel = K (X/Z, Y/Z, 1).
        Orthographic: pixel = K (X, Y, 1), so that fx and fy are pixels per scene unit.
    size : (width, height)
        In pixels.
    world_from_camera : array_like (4, 4)
        The rigid motion from the camera's frame to the world's, in scene units. Default: the identity.
    projection : "perspective" or "orthographic"
    lens : Lens, optional
        Of a perspective camera: where it sees the position (X/Z, Y/Z), which K then turns into pixels. One that
        distorts nothing becomes None.

    Raises
    ------
    ArgumentError
        If K is not of that form, the size not two positive integers, or the pose not rigid.

    Examples
    --------
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (640, 480))
    >>> pixels, depth = camera.project([[0.0, 0.0, 2.0]])
    >>> pixels.tolist(), depth.tolist()
    ([[319.5, 239.5]], [2.0])
    """

    K: Float64
    size: tuple[int, int]
    world_from_camera: Float64
    projection: Projection
    lens: Lens | None

    def __init__(
        self,
        K: ArrayLike,
        size: tuple[int, int],
        world_from_camera: ArrayLike | None = None,
        *,
        projection: Projection = "perspective",
        lens: Lens | None = None,
    ) -> None:
        one_of("projection", projection, Projection)
        if lens is not None and not instance_of("lens", lens, Lens, "a pyibr.Lens or None").bends:
            lens = None
        if lens is not None and projection == "orthographic":
            raise ArgumentError("lens", "None for an orthographic camera", describe(lens))
        pose = np.eye(4) if world_from_camera is None else checked_pose(world_from_camera)
        self.__dict__.update(
            K=read_only(checked_intrinsics(K)),
            size=checked_size(size),
            world_from_camera=read_only(pose),
            projection=projection,
            lens=lens,
        )

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError(f"a Camera is immutable: make a new one instead of setting {name}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Camera) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[partial[Camera], tuple[Float64, tuple[int, int], Float64]]:
        made = partial(Camera, projection=self.projection, lens=self.lens)
        return made, (self.K, self.size, self.world_from_camera)

    def __repr__(self) -> str:
        (fx, skew, cx), (_, fy, cy), _ = self.K.tolist()
        at = ", ".join(f"{v:g}" for v in self.center)
        return (
            f"<Camera {self.projection} {self.width}x{self.height} fx={fx:g} fy={fy:g} cx={cx:g} cy={cy:g}"
            f"{f' skew={skew:g}' if skew else ''}{f' {self.lens.model}' if self.lens else ''} at ({at})>"
        )

    @cached_property
    def _key(self) -> tuple[bytes, tuple[int, int], bytes, str, Lens | None]:
        # + 0.0 turns -0.0 into 0.0, so that equal numbers give equal bytes
        pose = (self.world_from_camera + 0.0).tobytes()
        return (self.K + 0.0).tobytes(), self.size, pose, self.projection, self.lens

    @property
    def width(self) -> int:
        """Width in pixels."""
        return self.size[0]

    @property
    def height(self) -> int:
        """Height in pixels."""
        return self.size[1]

    @cached_property
    def camera_from_world(self) -> Float64:
        """(4, 4) inverse of `world_from_camera`."""
        inverse = np.eye(4)
        inverse[:3, :3] = np.linalg.inv(self.world_from_camera[:3, :3])
        inverse[:3, 3] = -inverse[:3, :3] @ self.center
        return read_only(inverse)

    @property
    def center(self) -> Float64:
        """(3,) origin of the camera's frame in the world: a perspective camera's centre of projection."""
        return self.world_from_camera[:3, 3]

    @property
    def forward(self) -> Float64:
        """(3,) viewing direction (the camera's +z) in the world."""
        return self.world_from_camera[:3, 2]

    @cached_property
    def pixel_matrix(self) -> Float64:
        """(4, 4) map from the camera's frame to homogeneous pixel space.

        (X, Y, Z, 1) becomes (U, V, W, Q) with pixel = (U/W, V/W). A larger Q/W is nearer: it is 1/Z for a
        perspective camera and -Z for an orthographic one. A lens is left out: it is the map of a pinhole.
        """
        matrix = np.zeros((4, 4))
        if self.projection == "perspective":
            matrix[:3, :3] = self.K
            matrix[3, 3] = 1
        else:
            matrix[:2, [0, 1, 3]] = self.K[:2]
            matrix[2, 3] = 1
            matrix[3, 2] = -1
        return read_only(matrix)

    @classmethod
    def look_at(
        cls,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
        size: tuple[int, int],
        *,
        fov_y: float = 50.0,
        projection: Projection = "perspective",
        height: float | None = None,
    ) -> Camera:
        """Make a camera at `eye` that sees `target` in the middle of its image.

        Parameters
        ----------
        eye, target, up : array_like (3,)
            World points in scene units, and the world direction that points up in the image.
        size : (width, height)
            In pixels, which are square.
        fov_y : float
            Perspective: degrees that the image's height covers, between 0 and 180.
        projection : "perspective" or "orthographic"
        height : float
            Orthographic (only, and then required): scene units that the image's height covers.

        Examples
        --------
        >>> import pyibr as ibr
        >>> camera = ibr.Camera.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0), (61, 37), fov_y=40)
        >>> camera.forward.tolist()
        [0.0, 0.0, -1.0]
        """
        one_of("projection", projection, Projection)
        size = checked_size(size)
        at = numbers("eye", eye, (3,))
        forward = numbers("target", target, (3,)) - at
        distance = np.linalg.norm(forward)
        if distance == 0:
            raise ArgumentError("target", "a point other than eye", describe(target))
        forward /= distance
        upward = numbers("up", up, (3,))
        right = np.cross(forward, upward)
        sine = np.linalg.norm(right)
        if sine <= 1e-9 * np.linalg.norm(upward):
            raise ArgumentError("up", "a direction not along the line from eye to target", describe(up))
        right /= sine
        if projection == "perspective":
            if height is not None:
                raise ArgumentError("height", "None for a perspective camera (use fov_y)", describe(height))
            half = np.radians(positive("fov_y", fov_y, "degrees between 0 and 180")) / 2
            if half >= np.pi / 2:
                raise ArgumentError("fov_y", "degrees between 0 and 180", describe(fov_y))
            focal = size[1] / 2 / np.tan(half)
        else:
            focal = size[1] / positive("height", height, "scene units > 0 covered by the image's height")
        pose = np.eye(4)
        pose[:3] = np.column_stack([right, np.cross(forward, right), forward, at])
        K = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
        return cls(K, size, pose, projection=projection)

    def moved(self, dx: float, dy: float, dz: float) -> Camera:
        """Return this camera moved by (dx, dy, dz) scene units along its own axes: right, down, forward."""
        pose = self.world_from_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ numbers("(dx, dy, dz)", (dx, dy, dz), (3,))
        return Camera(self.K, self.size, pose, projection=self.projection, lens=self.lens)

    def orbited(self, degrees: float, pivot: ArrayLike, *, axis: ArrayLike | None = None) -> Camera:
        """Return this camera turned, with its position, about a line in the world.

        Parameters
        ----------
        degrees : float
            Right-handed about `axis`: with the default axis, a positive angle moves a camera that looks at
            the pivot to its right.
        pivot : array_like (3,)
            A world point on the line; its place in the image does not change if it is on the optical axis.
        axis : array_like (3,)
            The line's direction in the world. Default: the camera's up, its -y.
        """
        (angle,) = np.radians(numbers("degrees", [degrees], (1,)))
        direction = -self.world_from_camera[:3, 1] if axis is None else numbers("axis", axis, (3,))
        length = np.linalg.norm(direction)
        if length == 0:
            raise ArgumentError("axis", "a direction", "zeros")
        center = numbers("pivot", pivot, (3,))
        turn = conventions.rotation_from_opencv(angle * direction / length)
        pose = np.eye(4)
        pose[:3, :3] = turn @ self.world_from_camera[:3, :3]
        pose[:3, 3] = turn @ (self.center - center) + center
        return Camera(self.K, self.size, pose, projection=self.projection, lens=self.lens)

    def resized(self, size: tuple[int, int]) -> Camera:
        """Return the camera of the same view at another resolution; the image's borders stay."""
        width, height = checked_size(size)
        sx, sy = width / self.width, height / self.height
        scale = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])
        return Camera(
            scale @ self.K, (width, height), self.world_from_camera, projection=self.projection, lens=self.lens
        )

    def project(self, points: ArrayLike) -> tuple[Float64, Float64]:
        """Return the pixels (N, 2) and depths (N,) of world points (N, 3).

        Nothing is clipped to the image. A perspective camera has no pixel (NaN) for a point of depth <= 0, nor for one
        that its lens does not see.
        """
        world = numbers("points", points, (None, 3), finite=False)
        local = world @ self.camera_from_world[:3, :3].T + self.camera_from_world[:3, 3]
        depth = local[:, 2].copy()
        if self.projection == "perspective":
            with np.errstate(divide="ignore", invalid="ignore"):
                local[:, :2] /= np.where(depth > 0, depth, np.nan)[:, None]
        seen = local[:, :2] if self.lens is None else self.lens.distort(local[:, :2])
        return seen @ self.K[:2, :2].T + self.K[:2, 2], depth

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> Float64:
        """Return the world points (N, 3) at `pixels` (N, 2) and planar `depth` (N,). Inverts `project`.

        NaN at pixels at which the lens sees nothing.
        """
        at = numbers("pixels", pixels, (None, 2), finite=False)
        z = numbers("depth", depth, (len(at),), finite=False)
        local = np.column_stack([self.ideal_positions(at), z])
        if self.projection == "perspective":
            local[:, :2] *= z[:, None]
        return local @ self.world_from_camera[:3, :3].T + self.center

    def ideal_positions(self, pixels: ArrayLike) -> Float64:
        """Return where the rays of `pixels` (N, 2) pass the plane z = 1 of the camera's frame: (N, 2).

        Of a perspective camera (x, y, 1) is the ray's direction. NaN at pixels at which its lens sees nothing.
        """
        at = numbers("pixels", pixels, (None, 2), finite=False)
        seen = (at - self.K[:2, 2]) @ np.linalg.inv(self.K[:2, :2]).T
        return seen if self.lens is None else self.lens.undistort(seen)

    @classmethod
    def from_opencv(
        cls,
        K: ArrayLike,
        rotation: ArrayLike,
        translation: ArrayLike,
        size: tuple[int, int],
        distortion: ArrayLike | None = None,
        *,
        fisheye: bool = False,
    ) -> Camera:
        """Make a camera from OpenCV's extrinsics, x_camera = R x_world + t.

        Parameters
        ----------
        K : array_like (3, 3)
        rotation : array_like
            An axis-angle vector (`rvec`, 3 numbers) or a (3, 3) matrix.
        translation : array_like (3,)
            `tvec`.
        size : (width, height)
        distortion : array_like, optional
            `distCoeffs`, see `Lens.from_opencv`. None if the image has none.
        fisheye : bool
            The coefficients are those of `cv2.fisheye`.

        Examples
        --------
        >>> import pyibr as ibr
        >>> K = [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]
        >>> ibr.Camera.from_opencv(K, (0, 0, 0), (0, 0, 0), (640, 480), [-0.2, 0.05, 0, 0]).lens
        <Lens brown_conrady -0.2 0.05 0 0 0>
        """
        R = conventions.rotation_from_opencv(rotation)
        t = numbers("translation", np.asarray(translation).reshape(-1), (3,))
        checked_bool("fisheye", fisheye)
        lens = None if distortion is None else Lens.from_opencv(distortion, fisheye=fisheye)
        return cls(K, size, conventions.pose_from_extrinsics(R, t), lens=lens)

    def to_opencv(self) -> tuple[Float64, Float64, Float64]:
        """Return OpenCV's (K, rvec (3,), tvec (3,)); its `distCoeffs` are `lens.to_opencv()`."""
        self._require_perspective("OpenCV")
        pose = self.camera_from_world
        return self.K.copy(), conventions.rvec_from_rotation(pose[:3, :3]), pose[:3, 3].copy()

    @classmethod
    def from_opengl(
        cls, camera_to_world: ArrayLike, K: ArrayLike, size: tuple[int, int], *, pixel_center: float = 0.5
    ) -> Camera:
        """Make a camera from an OpenGL or NeRF pose: y up, looking along -z.

        Parameters
        ----------
        camera_to_world : array_like (4, 4)
            For column vectors, as `transform_matrix` in a NeRF `transforms.json`.
        K : array_like (3, 3)
            In pixels, y down the image.
        size : (width, height)
        pixel_center : float
            Where the centre of the top left pixel lies in the convention of `K`: 0.5 in OpenGL, instant-ngp
            and nerfstudio (cx = width / 2 is the middle), 0 if `K` comes from OpenCV.
        """
        pose = numbers("camera_to_world", camera_to_world, (4, 4)) @ conventions.CV_FROM_GL
        by = float(numbers("pixel_center", pixel_center, ()))
        return cls(conventions.with_principal_point_moved(numbers("K", K, (3, 3)), -by), size, pose)

    def to_opengl(self, *, pixel_center: float = 0.5) -> tuple[Float64, Float64]:
        """Return (camera_to_world (4, 4), K (3, 3)) as `from_opengl` takes them."""
        self._require_perspective("OpenGL", lens=False)
        K = conventions.with_principal_point_moved(self.K, float(numbers("pixel_center", pixel_center, ())))
        return self.world_from_camera @ conventions.CV_FROM_GL, K

    @classmethod
    def from_colmap(
        cls, model: str, params: ArrayLike, qvec: ArrayLike, tvec: ArrayLike, size: tuple[int, int]
    ) -> Camera:
        """Make a camera from COLMAP's, whose pixel centres are at halves.

        Parameters
        ----------
        model : str
            SIMPLE_PINHOLE, PINHOLE (which is that of undistorted images), SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV,
            SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE or OPENCV_FISHEYE.
        params : array_like
            As in `cameras.txt`, in the model's order.
        qvec, tvec : array_like (4,), (3,)
            As in `images.txt`: camera from world, the quaternion as (w, x, y, z).
        size : (width, height)
        """
        K, distortion, fisheye = conventions.intrinsics_from_colmap(model, params)
        rotation = conventions.rotation_from_quaternion(numbers("qvec", qvec, (4,)))
        pose = conventions.pose_from_extrinsics(rotation, numbers("tvec", tvec, (3,)))
        return cls(K, size, pose, lens=Lens.from_opencv(distortion, fisheye=fisheye))

    def to_colmap(self) -> tuple[str, Float64, Float64, Float64]:
        """Return COLMAP's (model, params, qvec (4,), tvec (3,)).

        The model is PINHOLE or, by the lens, OPENCV, FULL_OPENCV or OPENCV_FISHEYE.
        """
        self._require_perspective("COLMAP", skew=False)
        model, params = conventions.colmap_from_intrinsics(self.K, self.lens)
        pose = self.camera_from_world
        return model, params, conventions.quaternion_from_rotation(pose[:3, :3]), pose[:3, 3].copy()

    @classmethod
    def from_ros(cls, info: object, world_from_camera: ArrayLike | None = None) -> Camera:
        """Make the camera of a raw image from ROS's `sensor_msgs/CameraInfo`.

        Parameters
        ----------
        info : CameraInfo or mapping
            The message of ROS 1 or 2, a mapping of its fields, or the content of a calibration file (`ost.yaml`).
            Rectification is not looked at: it tells of another image.
        world_from_camera : array_like (4, 4), optional

        Examples
        --------
        >>> import pyibr as ibr
        >>> info = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "d": [-0.2, 0.05, 0, 0, 0]}
        >>> info["k"] = [500, 0, 319.5, 0, 500, 239.5, 0, 0, 1]
        >>> ibr.Camera.from_ros(info)
        <Camera perspective 640x480 fx=500 fy=500 cx=319.5 cy=239.5 brown_conrady at (0, 0, 0)>
        """
        K, size, lens = conventions.camera_from_ros(info)
        return cls(K, size, world_from_camera, lens=lens)

    def to_ros(self) -> conventions.RosCameraInfo:
        """Return the fields of ROS 2's `sensor_msgs/CameraInfo` that tell of the raw image."""
        self._require_perspective("ROS")
        return conventions.ros_from_camera(self.K, self.size, self.lens)

    @classmethod
    def from_realsense(cls, intrinsics: object, world_from_camera: ArrayLike | None = None) -> Camera:
        """Make a camera from RealSense's intrinsics.

        Parameters
        ----------
        intrinsics : pyrealsense2.intrinsics or mapping
            With its attributes width, height, fx, fy, ppx, ppy, model and coeffs. The model is pyrealsense2's, its name
            or its number; all but `ftheta`.
        world_from_camera : array_like (4, 4), optional

        Examples
        --------
        >>> import pyibr as ibr
        >>> intrinsics = {"width": 640, "height": 480, "fx": 500, "fy": 500, "ppx": 319.5, "ppy": 239.5}
        >>> intrinsics |= {"model": "inverse_brown_conrady", "coeffs": [-0.05, 0.06, 0, 0, -0.02]}
        >>> ibr.Camera.from_realsense(intrinsics).lens
        <Lens inverse_brown_conrady -0.05 0.06 0 0 -0.02>
        """
        K, size, lens = conventions.camera_from_realsense(intrinsics)
        return cls(K, size, world_from_camera, lens=lens)

    def to_realsense(self) -> conventions.RealSenseIntrinsics:
        """Return the attributes of `pyrealsense2.intrinsics`, the model by its name."""
        self._require_perspective("RealSense", skew=False)
        return conventions.realsense_from_camera(self.K, self.size, self.lens)

    @classmethod
    def from_kalibr(cls, camera: object, world_from_camera: ArrayLike | None = None) -> Camera:
        """Make a camera from an entry of Kalibr's `camchain.yaml`.

        Parameters
        ----------
        camera : mapping
            With camera_model (pinhole), intrinsics, distortion_model (radtan, equidistant or none), distortion_coeffs
            and resolution.
        world_from_camera : array_like (4, 4), optional
            Kalibr's own transforms (`T_cn_cnm1`, `T_cam_imu`) are not looked at: they lead to no world.
        """
        K, size, lens = conventions.camera_from_kalibr(camera)
        return cls(K, size, world_from_camera, lens=lens)

    def to_kalibr(self) -> conventions.KalibrCamera:
        """Return an entry of Kalibr's `camchain.yaml`, as `from_kalibr` takes it."""
        self._require_perspective("Kalibr", skew=False)
        return conventions.kalibr_from_camera(self.K, self.size, self.lens)

    @classmethod
    def from_azure_kinect(
        cls, calibration: object, mode: str, world_from_depth_camera: ArrayLike | None = None
    ) -> Camera:
        """Make the depth or the colour camera of an Azure Kinect from its raw calibration.

        Parameters
        ----------
        calibration : mapping
            The JSON of `k4a_device_get_raw_calibration`, or of the attachment `calibration.json` of a recording.
        mode : str
            Which images: NFOV_UNBINNED, NFOV_2X2BINNED, WFOV_UNBINNED, WFOV_2X2BINNED or PASSIVE_IR for those of the
            depth camera (depth and infrared), 720P, 1080P, 1440P, 1536P, 2160P or 3072P for colours. The SDK's longer
            names, as K4A_DEPTH_MODE_NFOV_UNBINNED, and a recording's, as MJPG_720P, will do.
        world_from_depth_camera : array_like (4, 4), optional
            In metres, as the calibration. Default: the world is the depth camera's frame.

        Examples
        --------
        >>> import pyibr as ibr
        >>> parameters = [0.51, 0.52, 0.49, 0.49, 0.55, -0.02, 0, 0.89, 0.09, -0.01, 0, 0, 0, 0]
        >>> model = "CALIBRATION_LensDistortionModelBrownConrady"
        >>> entry = {"Location": "CALIBRATION_CameraLocationD0", "SensorWidth": 1024, "SensorHeight": 1024}
        >>> entry |= {"Intrinsics": {"ModelType": model, "ModelParameters": parameters}, "MetricRadius": 1.74}
        >>> entry |= {"Rt": {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": [0, 0, 0]}}
        >>> ibr.Camera.from_azure_kinect({"CalibrationInformation": {"Cameras": [entry]}}, "NFOV_UNBINNED")
        <Camera perspective 640x576 fx=501.76 fy=501.76 cx=329.74 cy=351.98 rational at (0, 0, 0)>
        """
        K, size, lens, pose = conventions.camera_from_azure_kinect(calibration, mode)
        if world_from_depth_camera is not None:
            pose = checked_pose(world_from_depth_camera, "world_from_depth_camera") @ pose
        return cls(K, size, pose, lens=lens)

    @classmethod
    def from_pytorch3d(
        cls,
        R: ArrayLike,
        T: ArrayLike,
        focal_length: ArrayLike,
        principal_point: ArrayLike,
        size: tuple[int, int],
    ) -> Camera:
        """Make a camera from one PyTorch3D `PerspectiveCameras` in NDC; `size` is (width, height)."""
        size = checked_size(size)
        K, pose = conventions.camera_from_pytorch3d(R, T, focal_length, principal_point, size)
        return cls(K, size, pose)

    def to_pytorch3d(self) -> conventions.PyTorch3DCamera:
        """Return the arguments of PyTorch3D's `PerspectiveCameras`, without the batch dimension."""
        self._require_perspective("PyTorch3D", skew=False, lens=False)
        return conventions.pytorch3d_from_camera(self.K, self.size, self.camera_from_world)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Camera:
        """Read a camera from a JSON file.

        Keys: `width`, `height`, `K` (or `fx`, `fy`, `cx`, `cy`), and optionally `world_from_camera` (4, 4),
        `projection` and `lens` (with `model`, `coefficients` and, if it has one, `radius`). Or those of Open3D's
        PinholeCameraIntrinsic or PinholeCameraParameters. Raises FileFormatError, which names the file, for anything
        else.
        """
        return cls.from_json(read_json(path, "camera JSON"), path)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the camera as JSON, which `load` reads back to the same bits."""
        write_json(path, self.to_json())

    @classmethod
    def from_json(cls, data: object, path: str | PathLike[str] = "camera") -> Camera:
        """Make the camera that an object of a JSON file means, as `load` reads it; `path` is for error messages."""
        arguments = camera_arguments(data, path)
        try:
            return cls(**arguments)
        except ArgumentError as error:
            raise FileFormatError(f"{path}: {error}") from error

    def to_json(self) -> dict[str, Any]:
        """Return the camera as `save` writes it, for JSON files that hold more than that.

        Examples
        --------
        >>> import pyibr as ibr
        >>> camera = ibr.Camera([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (640, 480))
        >>> ibr.Camera.from_json(camera.to_json()) == camera
        True
        """
        return camera_entries(self.K, self.size, self.world_from_camera, self.projection, self.lens)

    def _require_perspective(self, name: str, skew: bool = True, lens: bool = True) -> None:
        if self.projection != "perspective":
            raise ArgumentError("camera", f"a perspective one for {name}", self.projection)
        if not skew and self.K[0, 1] != 0:
            raise ArgumentError("camera", f"no skew for {name}", f"K[0, 1] = {self.K[0, 1]:g}")
        if not lens and self.lens is not None:
            raise ArgumentError("camera", f"no lens for {name}", self.lens.model)
