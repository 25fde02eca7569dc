"""The camera that every part of pyibr shares.

Axes are OpenCV's: x right, y down, z forward. Pixel centres lie at integers: the centre of the top left
pixel is (0, 0), the image reaches from -0.5 to width - 0.5. Depth is planar: the z of a point in the
camera's frame. A lens moves the positions that a pinhole would see; K maps the moved positions to pixels.
"""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core import conventions, rotations
from pyibr.core.calibrations import cameras_in, chosen, listed, making, read_calibration
from pyibr.core.camera_geometry import CameraGeometry, Projection
from pyibr.core.camera_json import camera_entries, write_json
from pyibr.core.checks import Float64, checked_bool, checked_pose, checked_size, numbers
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.lens import Lens
from pyibr.core.shown import Shown

__all__ = ["Camera", "Projection"]


class Camera(CameraGeometry, Shown):
    """Pose and projection of an image: the map between its pixels and rays in the world. Immutable.

    Parameters
    ----------
    K : array_like (3, 3)
        [[fx, s, cx], [0, fy, cy], [0, 0, 1]], fx, fy > 0. Perspective: in pixels, pixel = K (X/Z, Y/Z, 1).
        Orthographic: pixel = K (X, Y, 1), so that fx and fy are pixels per scene unit.
    size : (width, height)
        In pixels.
    world_from_camera : array_like (4, 4)
        The rigid motion from the camera's frame to the world, in scene units. Default: the identity.
    projection : "perspective" or "orthographic"
    lens : Lens, optional
        Lens of a perspective camera: it distorts the position (X/Z, Y/Z), which K then maps to pixels. A lens without
        distortion becomes None.

    Raises
    ------
    ArgumentError
        If K does not have that form, the size is not two positive integers, or the pose is not rigid.

    Examples
    --------
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (640, 480))
    >>> pixels, depth = camera.project([[0.0, 0.0, 2.0]])
    >>> pixels.tolist(), depth.tolist()
    ([[319.5, 239.5]], [2.0])
    """

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
            `distCoeffs`, see `Lens.from_opencv`. None for an undistorted image.
        fisheye : bool
            Whether the coefficients are `cv2.fisheye`'s.

        Examples
        --------
        >>> import pyibr as ibr
        >>> K = [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]
        >>> ibr.Camera.from_opencv(K, (0, 0, 0), (0, 0, 0), (640, 480), [-0.2, 0.05, 0, 0]).lens
        <Lens brown_conrady -0.2 0.05 0 0 0>
        """
        R = rotations.rotation_from_opencv(rotation)
        t = numbers("translation", np.asarray(translation).reshape(-1), (3,))
        checked_bool("fisheye", fisheye)
        lens = None if distortion is None else Lens.from_opencv(distortion, fisheye=fisheye)
        return cls(K, size, conventions.pose_from_extrinsics(R, t), lens=lens)

    def to_opencv(self) -> tuple[Float64, Float64, Float64]:
        """Return OpenCV's (K, rvec (3,), tvec (3,)); use `lens.to_opencv()` for `distCoeffs`."""
        self._require_perspective("OpenCV")
        pose = self.camera_from_world
        return self.K.copy(), rotations.rvec_from_rotation(pose[:3, :3]), pose[:3, 3].copy()

    @classmethod
    def from_opengl(
        cls, camera_to_world: ArrayLike, K: ArrayLike, size: tuple[int, int], *, pixel_center: float = 0.5
    ) -> Camera:
        """Make a camera from an OpenGL or NeRF pose: y up, looking along -z.

        Parameters
        ----------
        camera_to_world : array_like (4, 4)
            For column vectors, such as `transform_matrix` in a NeRF `transforms.json`.
        K : array_like (3, 3)
            In pixels, y down the image.
        size : (width, height)
        pixel_center : float
            Position of the top left pixel's centre in the convention of `K`: 0.5 in OpenGL, instant-ngp and nerfstudio
            (cx = width / 2 is the middle), 0 if `K` comes from OpenCV.
        """
        pose = numbers("camera_to_world", camera_to_world, (4, 4)) @ conventions.CV_FROM_GL
        by = float(numbers("pixel_center", pixel_center, ()))
        return cls(conventions.with_principal_point_moved(numbers("K", K, (3, 3)), -by), size, pose)

    def to_opengl(self, *, pixel_center: float = 0.5) -> tuple[Float64, Float64]:
        """Return (camera_to_world (4, 4), K (3, 3)), the arguments of `from_opengl`."""
        self._require_perspective("OpenGL", lens=False)
        K = conventions.with_principal_point_moved(self.K, float(numbers("pixel_center", pixel_center, ())))
        return self.world_from_camera @ conventions.CV_FROM_GL, K

    @classmethod
    def from_colmap(
        cls, model: str, params: ArrayLike, qvec: ArrayLike, tvec: ArrayLike, size: tuple[int, int]
    ) -> Camera:
        """Make a camera from COLMAP's parameters, whose pixel centres are at halves.

        Parameters
        ----------
        model : str
            SIMPLE_PINHOLE, PINHOLE (for undistorted images), SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV,
            SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE or OPENCV_FISHEYE.
        params : array_like
            As in `cameras.txt`, in the model's order.
        qvec, tvec : array_like (4,), (3,)
            As in `images.txt`: camera from world, the quaternion as (w, x, y, z).
        size : (width, height)
        """
        K, distortion, fisheye = conventions.intrinsics_from_colmap(model, params)
        rotation = rotations.rotation_from_quaternion(numbers("qvec", qvec, (4,)))
        pose = conventions.pose_from_extrinsics(rotation, numbers("tvec", tvec, (3,)))
        return cls(K, size, pose, lens=Lens.from_opencv(distortion, fisheye=fisheye))

    def to_colmap(self) -> tuple[str, Float64, Float64, Float64]:
        """Return COLMAP's (model, params, qvec (4,), tvec (3,)).

        The model depends on the lens: PINHOLE, OPENCV, FULL_OPENCV or OPENCV_FISHEYE.
        """
        self._require_perspective("COLMAP", skew=False)
        model, params = conventions.colmap_from_intrinsics(self.K, self.lens)
        pose = self.camera_from_world
        return model, params, rotations.quaternion_from_rotation(pose[:3, :3]), pose[:3, 3].copy()

    @classmethod
    def from_ros(cls, info: object, world_from_camera: ArrayLike | None = None) -> Camera:
        """Make the camera of a raw image from ROS's `sensor_msgs/CameraInfo`.

        Parameters
        ----------
        info : CameraInfo or mapping
            The message of ROS 1 or 2, a mapping of its fields, or the content of a calibration file (`ost.yaml`). Its
            rectification is ignored, since it belongs to another image.
        world_from_camera : array_like (4, 4), optional

        Examples
        --------
        >>> import pyibr as ibr
        >>> info = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "d": [-0.2, 0.05, 0, 0, 0]}
        >>> info["k"] = [500, 0, 319.5, 0, 500, 239.5, 0, 0, 1]
        >>> ibr.Camera.from_ros(info)
        <Camera perspective 640x480 fx=500 fy=500 cx=319.5 cy=239.5 brown_conrady at (0, 0, 0)>
        """
        return cls(**conventions.camera_from_ros(info), world_from_camera=world_from_camera)

    def to_ros(self) -> dict[str, Any]:
        """Return the fields of ROS 2's `sensor_msgs/CameraInfo` that describe the raw image."""
        self._require_perspective("ROS")
        return conventions.ros_from_camera(self.K, self.size, self.lens)

    @classmethod
    def from_realsense(cls, intrinsics: object, world_from_camera: ArrayLike | None = None) -> Camera:
        """Make a camera from RealSense's intrinsics.

        Parameters
        ----------
        intrinsics : pyrealsense2.intrinsics or mapping
            With attributes or keys width, height, fx, fy, ppx, ppy, model and coeffs. The model is pyrealsense2's enum
            value, name or number; `ftheta` is not supported.
        world_from_camera : array_like (4, 4), optional

        Examples
        --------
        >>> import pyibr as ibr
        >>> intrinsics = {"width": 640, "height": 480, "fx": 500, "fy": 500, "ppx": 319.5, "ppy": 239.5}
        >>> intrinsics |= {"model": "inverse_brown_conrady", "coeffs": [-0.05, 0.06, 0, 0, -0.02]}
        >>> ibr.Camera.from_realsense(intrinsics).lens
        <Lens inverse_brown_conrady -0.05 0.06 0 0 -0.02>
        """
        return cls(**conventions.camera_from_realsense(intrinsics), world_from_camera=world_from_camera)

    def to_realsense(self) -> dict[str, Any]:
        """Return the attributes of `pyrealsense2.intrinsics`, with the model's name."""
        self._require_perspective("RealSense", skew=False)
        return conventions.realsense_from_camera(self.K, self.size, self.lens)

    @classmethod
    def from_kalibr(cls, camera: object, world_from_camera: ArrayLike | None = None) -> Camera:
        """Make a camera from an entry of Kalibr's `camchain.yaml`.

        Parameters
        ----------
        camera : mapping
            With keys camera_model (pinhole), intrinsics, distortion_model (radtan, equidistant or none),
            distortion_coeffs
            and resolution.
        world_from_camera : array_like (4, 4), optional
            Kalibr's own transforms (`T_cn_cnm1`, `T_cam_imu`) are ignored: they do not lead to a world.
        """
        return cls(**conventions.camera_from_kalibr(camera), world_from_camera=world_from_camera)

    def to_kalibr(self) -> dict[str, Any]:
        """Return an entry of Kalibr's `camchain.yaml`, the argument of `from_kalibr`."""
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
            The JSON of `k4a_device_get_raw_calibration`, or a recording's attachment `calibration.json`.
        mode : str
            Mode of the images: NFOV_UNBINNED, NFOV_2X2BINNED, WFOV_UNBINNED, WFOV_2X2BINNED or PASSIVE_IR for the depth
            camera (depth and infrared), 720P, 1080P, 1440P, 1536P, 2160P or 3072P for colours. The SDK's longer names,
            such as K4A_DEPTH_MODE_NFOV_UNBINNED, and a recording's, such as MJPG_720P, are accepted, too.
        world_from_depth_camera : array_like (4, 4), optional
            In metres, as in the calibration. Default: the world is the depth camera's frame.

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
        made = conventions.camera_from_azure_kinect(calibration, mode)
        if world_from_depth_camera is not None:
            made["world_from_camera"] = (
                checked_pose(world_from_depth_camera, "world_from_depth_camera") @ made["world_from_camera"]
            )
        return cls(**made)

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
        return cls(**conventions.camera_from_pytorch3d(R, T, focal_length, principal_point, checked_size(size)))

    def to_pytorch3d(self) -> dict[str, Any]:
        """Return the arguments of PyTorch3D's `PerspectiveCameras`, without the batch dimension."""
        self._require_perspective("PyTorch3D", skew=False, lens=False)
        return conventions.pytorch3d_from_camera(self.K, self.size, self.camera_from_world)

    @classmethod
    def from_normalized(cls, K: ArrayLike, size: tuple[int, int], world_from_camera: ArrayLike | None = None) -> Camera:
        """Make a camera from a K (3, 3) in fractions of the picture's width and height, as networks return it.

        The middle of the picture is at (0.5, 0.5).

        Examples
        --------
        >>> import pyibr as ibr
        >>> ibr.Camera.from_normalized([[1, 0, 0.5], [0, 1.25, 0.5], [0, 0, 1]], (640, 480))
        <Camera perspective 640x480 fx=640 fy=600 cx=319.5 cy=239.5 at (0, 0, 0)>
        """
        size = checked_size(size)
        return cls(conventions.intrinsics_from_normalized(numbers("K", K, (3, 3)), size), size, world_from_camera)

    @classmethod
    def load(cls, path: str | PathLike[str], *, size: tuple[int, int] | None = None) -> Camera:
        """Read a camera from a file, and detect the format from its content.

        Parameters
        ----------
        path : path
            A file from `save`, or a calibration of Open3D, ROS (YAML, INI), OpenCV (YAML, XML, JSON), Kalibr, EuRoC,
            camodocal, RealSense, Azure Kinect, Orbbec, OAK (DepthAI) or NeRF's `transforms.json`; or K as 3 x 3, 3 x 4
            or 4 x 4 numbers, in pixels or in fractions of the picture's size; or fx fy cx cy [k1 k2 p1 p2 ...]. For
            files of several cameras, append a name, as in ``camchain.yaml#cam1``; an Azure Kinect's names are its
            modes, as in ``calibration.json#720P``. Keys that look like a lens or a pose and are not read give a
            warning; a lens that pyibr lacks is refused.
        size : (width, height), optional
            The pictures' size, for files that lack it. Without a name, the camera of this size is chosen.

        Raises
        ------
        FileFormatError
            If the format is unknown, or the file holds several cameras; the error lists them.

        Examples
        --------
        >>> from pathlib import Path
        >>> import pyibr as ibr
        >>> _ = Path("K.txt").write_text("500 0 319.5\\n0 500 239.5\\n0 0 1\\n")
        >>> ibr.Camera.load("K.txt", size=(640, 480))
        <Camera perspective 640x480 fx=500 fy=500 cx=319.5 cy=239.5 at (0, 0, 0)>
        """
        file, name, tree = read_calibration(path)
        return cls._of_tree(tree, file, name, None if size is None else checked_size(size))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the camera as JSON; `load` reads it back bit for bit."""
        write_json(path, self.to_json())

    @classmethod
    def from_json(cls, data: object, path: str | PathLike[str] = "camera") -> Camera:
        """Make a camera from an object of a JSON file, as `load` does; `path` is for error messages."""
        return cls._of_tree(data, path)

    @classmethod
    def _of_tree(
        cls, tree: object, path: str | PathLike[str], name: str | None = None, size: tuple[int, int] | None = None
    ) -> Camera:
        with making(path):
            found = chosen(cameras_in(tree, path, size), name, path, size)
            if len(found) > 1:
                raise FileFormatError(f"{path}: expected one camera, as {path}#NAME; got {listed(found)}")
            (make,) = found.values()
            return cls(**make())

    def to_json(self) -> dict[str, Any]:
        """Return the camera as `save` writes it, as a JSON object for files that hold more than a camera.

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
            raise ArgumentError("camera", f"a perspective camera for {name}", self.projection)
        if not skew and self.K[0, 1] != 0:
            raise ArgumentError("camera", f"no skew for {name}", f"K[0, 1] = {self.K[0, 1]:g}")
        if not lens and self.lens is not None:
            raise ArgumentError("camera", f"no lens for {name}", self.lens.model)
