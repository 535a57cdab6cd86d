import numpy as np
import pytest

from springgym.rendering import Camera

FOV = 2.0 * np.arctan(0.5)  # scale is then the height of the picture in pixels


def test_projection_by_hand():
    camera = Camera(eye=(0.0, -4.0, 0.0), target=(0.0, 0.0, 0.0), fov=FOV)
    pixels, depth = camera.project([(0, 0, 0), (1, 0, 0.5), (-1, 4, 0)], (200, 100))
    # scale = 50 / tan(fov/2) = 100; x = 100 + 100 * 1/4, y = 50 - 100 * 0.5/4; at depth 8: 100 - 100/8
    np.testing.assert_allclose(pixels, [(100, 50), (125, 37.5), (87.5, 50)], atol=1e-12)
    np.testing.assert_allclose(depth, [4, 4, 8], atol=1e-12)


def test_projection_from_above_by_hand():
    # Looking along (0, 0.6, -0.8): right is x, up is (0, 0.8, 0.6).
    camera = Camera(eye=(0.0, -3.0, 4.0), target=(0.0, 0.0, 0.0), fov=FOV)
    np.testing.assert_allclose(camera.axes(), [(1, 0, 0), (0, 0.8, 0.6), (0, 0.6, -0.8)], atol=1e-12)
    pixels, depth = camera.project((0.5, 0.0, 1.0), (100, 100))
    # depth = 5 - 0.8 = 4.2; x = 50 + 100 * 0.5/4.2, y = 50 - 100 * 0.6/4.2
    np.testing.assert_allclose(pixels, (50 + 50 / 4.2, 50 - 60 / 4.2), atol=1e-12)
    np.testing.assert_allclose(depth, 4.2, atol=1e-12)


def test_no_image_behind_the_eye():
    camera = Camera(eye=(0.0, -4.0, 0.0), target=(0.0, 0.0, 0.0))
    pixels, depth = camera.project([(0, -4, 0), (0, -5, 0), (0, 1, 0)], (100, 100))
    assert np.isnan(pixels[:2]).all()
    assert np.isnan(depth[:2]).all()
    assert np.isfinite(pixels[2]).all()


def test_rays_go_through_their_pixels():
    camera = Camera.framing((0.2, -0.1, 0.4), 2.0, azimuth=0.7, elevation=0.4)
    rays = camera.rays((8, 6))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-12)
    pixels, _ = camera.project(camera.eye + 3.0 * rays, (8, 6))
    x, y = np.meshgrid(np.arange(8) + 0.5, np.arange(6) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([x, y], axis=-1), atol=1e-9)


def test_framing_fits_the_sphere_into_the_height():
    center = np.array([1.0, 2.0, 3.0])
    camera = Camera.framing(center, 2.0, azimuth=0.3, elevation=0.0)
    angle = np.linspace(0, 2 * np.pi, 20001)
    to_eye = (np.array(camera.eye) - center) / np.linalg.norm(np.array(camera.eye) - center)
    circle = center + np.cos(angle)[:, None] * to_eye + np.sin(angle)[:, None] * np.array([0, 0, 1.0])
    height = camera.project(circle, (400, 400))[0][:, 1]
    # The widest of 20001 points is within (2 pi/20001)^2 of touching the upper and lower edge.
    np.testing.assert_allclose([height.min(), height.max()], [0, 400], atol=1e-3)
    np.testing.assert_allclose(np.arctan2(to_eye[1], to_eye[0]), 0.3)


@pytest.mark.parametrize(
    ("eye", "target", "fov", "message"),
    [
        ((0, 0, 1), (0, 0, 0), 0.5, "straight above"),
        ((1, 1, 1), (1, 1, 1), 0.5, "straight above"),
        ((np.nan, 0, 1), (0, 0, 0), 0.5, "eye"),
        ((1, 0, 1), (0, 0), 0.5, "target"),
        ((1, 0, 1), (0, 0, 0), 0.0, "fov"),
        ((1, 0, 1), (0, 0, 0), 3.2, "fov"),
    ],
)
def test_impossible_cameras(eye, target, fov, message):
    with pytest.raises(ValueError, match=message):
        Camera(eye, target, fov)


@pytest.mark.parametrize("size", [(64, 64), (96, 48), (48, 96)])
def test_keeping_points_in_view(size):
    """A camera that sees them stays; else it looks at their middle, from the same side and no nearer."""
    camera = Camera.framing((0.0, 0.0, 1.0), 2.0)
    rng = np.random.default_rng(0)
    cloud = rng.uniform(-0.2, 0.2, (20, 3)) + np.array([0.0, 0.0, 1.0])
    assert camera.keeping(cloud, size) is camera
    for away, spread in (
        ((3.0, -2.0, 7.0), 1.0),
        ((0.0, 0.0, -40.0), 1.0),
        ((1e4, 0.0, 0.0), 30.0),
        ((0, 0, 0), 9.0),
    ):
        points = spread * (cloud - (0, 0, 1)) + (0, 0, 1) + np.array(away, float)
        moved = camera.keeping(points, size)
        pixels, _ = moved.project(points, size)
        assert ((pixels > 0) & (pixels < size)).all()
        np.testing.assert_allclose(moved.axes(), camera.axes(), atol=1e-9)
        distance = [np.linalg.norm(np.subtract(c.eye, c.target)) for c in (camera, moved)]
        assert distance[1] >= distance[0] * (1 - 1e-9)
        assert (distance[1] > 1.01 * distance[0]) == (spread > 8)
        assert moved.keeping(points, size) is moved


def test_keeping_what_is_lost():
    camera = Camera.framing((0.0, 0.0, 1.0), 2.0)
    for points in (np.zeros((0, 3)), np.full((2, 3), np.nan), np.full((1, 3), np.inf)):
        assert camera.keeping(points, (64, 64)) is camera
    assert camera.keeping([(1e20, 0.0, 0.0)], (64, 64)) is camera
    assert camera.keeping([(1e8, 0.0, 0.0)], (64, 64)).target == (1e8, 0.0, 0.0)
    assert camera.keeping([(np.nan, 0, 0), (50.0, 0, 0)], (64, 64)).target == (50.0, 0.0, 0.0)


@pytest.mark.parametrize("size", [(300, 300), (640, 200), (200, 640)])
@pytest.mark.parametrize("elevation", [-0.5, 0.0, 1.2])
def test_fitting_sees_all_points_and_comes_as_near_as_that_allows(size, elevation):
    rng = np.random.default_rng(7)
    for _ in range(20):
        points = rng.normal(size=(30, 3)) + 5 * rng.normal(size=3)
        camera = Camera.fitting(points, size, rng.uniform(-3, 3), elevation, margin=0.1)
        shares = camera.project(points, size)[0] / size
        assert (shares > 0.1 - 1e-6).all()
        assert (shares < 0.9 + 1e-6).all()
        touched = np.minimum(shares.min(axis=0), 1 - shares.max(axis=0))
        assert touched.min() == pytest.approx(0.1, abs=1e-6)


def test_fitting_leaves_out_what_is_not_finite():
    points = np.array([[0.0, 0, 0], [1, 1, 1]])
    lost = np.vstack([points, [np.nan, 0, 0]])
    assert Camera.fitting(lost) == Camera.fitting(points)
    with pytest.raises(ValueError, match="no finite point"):
        Camera.fitting(lost[2:])


def test_fitting_sees_a_single_point():
    camera = Camera.fitting([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(camera.project([1.0, 2.0, 3.0], (200, 100))[0], (100, 50), atol=1e-6)


def test_moved():
    camera = Camera((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.4).moved((0.0, 1.0, -1.0))
    assert camera == Camera((1.0, 3.0, 2.0), (0.0, 1.0, -1.0), 0.4)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"center": (0, 0)}, "center is"),
        ({"center": "x"}, "center is 'x'"),
        ({"center": (0, 0, np.nan)}, "center"),
        ({"size": -1}, "size is -1; it must be a positive number"),
        ({"size": 0.0}, "size is 0.0; it must be a positive number"),
        ({"size": True}, "size is True"),
        ({"azimuth": None}, "azimuth is None"),
        ({"elevation": np.inf}, "elevation is inf"),
        ({"fov": 4.0}, "fov is 4.0"),
        ({"fov": 0}, "fov is 0"),
    ],
)
def test_what_frames_nothing_is_refused(wrong, says):
    with pytest.raises((TypeError, ValueError), match=says):
        Camera.framing(**{"center": (0, 0, 0), "size": 1.0, **wrong})
