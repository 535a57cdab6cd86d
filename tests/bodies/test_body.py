import copy
import math
import pickle
import re
from dataclasses import asdict

import numpy as np
import pytest

from springgym.model.bodies import Body, box, cube, gyroscope, rope, top, vibrations
from springgym.model.bodies.body import EXACT, MOST_PARTICLES, inertia, rigid_motions, rigidity_matrix

TRIANGLE = {
    "name": "triangle",
    "positions": [[0, 0, 0], [3, 0, 0], [0, 4, 0]],
    "masses": [1, 2, 3],
    "springs": [(0, 1), (1, 2), (2, 0)],
    "stiffness": 10.0,
    "damping": 1.0,
}


def triangle(**changes):
    return Body(**TRIANGLE | changes)


def test_lengths_are_those_of_the_shape():
    assert triangle().lengths.tolist() == [3, 5, 4]
    assert triangle(lengths=[3, 4, 5]).lengths.tolist() == [3, 4, 5]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": []}, "it has 0 particles"),
        ({"positions": [[0, 0, 0], [1, 0, math.nan], [0, 1, 0]]}, "body 'triangle': positions[1, 2] is nan"),
        (
            {"positions": [[0, 0, 0], [0, 0, 0], [0, 1, 0]]},
            "spring 0 of body 'triangle' joins particles 0 and 1, which are at the same position",
        ),
        ({"masses": [1, 0, 3]}, "body 'triangle': masses[1] is 0"),
        ({"stiffness": [1, 0, 1]}, "body 'triangle': stiffness[1] is 0"),
        ({"damping": [1, 1, -1]}, "body 'triangle': damping[2] is -1"),
        ({"lengths": [3, 0, 5]}, "body 'triangle': lengths[1] is 0"),
        (
            {"springs": [(0, 1), (1, 3), (2, 0)]},
            "body 'triangle': springs[1, 1] is 3; it must be a whole number from 0 to 2",
        ),
        ({"springs": [(0, 1), (1, 2), (2, 2)]}, "spring 2 of body 'triangle' joins particle 2 to itself"),
        ({"springs": [(0, 1), (1, 2), (1, 0)]}, "spring 2 of body 'triangle' joins particles 1 and 0, which"),
        ({"springs": [(0, 1)]}, "nothing joins particle 2 to particle 0"),
        ({"springs": [(0, 1), (1, 2)]}, "1 zero-energy mode)"),
        ({"markers": (0, 0, 1)}, "markers is (0, 0, 1); the first two must be at different positions"),
        ({"markers": (0, 1, 3)}, "body 'triangle': markers[2] is 3"),
        ({"parts": {"end": (5,)}}, "body 'triangle': parts['end'][0] is 5"),
        ({"parts": {"end": ()}}, "body 'triangle': parts['end'] has no particles"),
        ({"triangles": [(0, 1, 7)]}, "body 'triangle': triangles[0, 2] is 7"),
    ],
)
def test_error_names_the_offender(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        triangle(**changes)


def test_large_bodies_are_checked_fast_or_refused():
    assert top(ring=MOST_PARTICLES // 2).floppy_modes() == 0  # by the square of the rigidity matrix
    unbraced = top(ring=EXACT + 1)
    kept = [s for s in range(len(unbraced.springs)) if 0 not in unbraced.springs[s] or s == 0]
    with pytest.raises(ValueError, match="2 zero-energy modes"):
        unbraced.with_(springs=unbraced.springs[kept], stiffness=1e6, damping=0.0, lengths=None)
    for make in (lambda n: top(ring=n), lambda n: gyroscope(ring=n), lambda n: rope(beads=n)):
        for count in (MOST_PARTICLES + 1, 10**9, 10**400):
            with pytest.raises(ValueError, match=r"(ring|beads) is .*; it must be a whole number from"):
                make(count)
    cloud = np.zeros((MOST_PARTICLES + 1, 3))
    with pytest.raises(ValueError, match="it has 1001 particles; it must have from 1 to 1000"):
        Body("cloud", cloud, 1.0, [], 1.0, 0.0)
    line = np.arange(300)[:, None] * (1.0, 0.0, 0.0)
    pairs = np.array([(i, j) for i in range(300) for j in range(i)])
    with pytest.raises(ValueError, match="has 44850 springs; it must have at most 20000"):
        Body("line", line, 1.0, pairs, 1.0, 0.0)


def test_a_body_cannot_be_changed():
    body = triangle()
    with pytest.raises(ValueError, match="read-only"):
        body.masses[0] = 5
    named = triangle().with_(parts={"tip": (0,)})
    for one in (
        named,
        named.with_(),
        copy.copy(named),
        copy.deepcopy(named),
        pickle.loads(pickle.dumps(named)),
    ):
        with pytest.raises(TypeError, match="does not support item assignment"):
            one.parts["tip"] = (1,)
        assert one.parts == {"tip": (0,)}
    assert asdict(named)["parts"] == {"tip": (0,)}
    assert body.with_(masses=[4, 5, 6]).mass == 15
    assert body.mass == 6


def test_mass_properties_against_sums_over_the_particles():
    body = triangle()
    assert body.centre == pytest.approx([1, 2, 0])
    about = np.array([1.0, 0.0, 2.0])
    tensor = np.zeros((3, 3))
    for m, x in zip(body.masses, body.positions, strict=True):
        r = x - about
        tensor += m * (r @ r * np.eye(3) - np.outer(r, r))
    assert body.inertia(about) == pytest.approx(tensor, rel=1e-14)
    moments, axes = body.principal(about)
    assert axes @ np.diag(moments) @ axes.T == pytest.approx(tensor, abs=1e-13)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert (np.diff(moments) > 0).all()


def test_parallel_axes():
    body = box((1.0, 0.7, 0.4), (0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1))
    d = np.array([0.3, -2.0, 1.0])
    shifted = body.inertia() + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    assert body.inertia(body.centre + d) == pytest.approx(shifted, rel=1e-13)


def test_floppy_modes_are_counted():
    square = {
        "name": "square",
        "positions": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
        "masses": np.ones(4),
        "springs": [(0, 1), (1, 2), (2, 3), (3, 0)],
        "stiffness": 1.0,
        "damping": 0.0,
        "floppy": True,
    }
    assert Body(**square).floppy_modes() == 2  # it shears, and folds out of its plane
    assert Body(**square).floppy_modes((0, 1, 3)) == 1  # particle 2 moves out of the plane
    assert rope(beads=5).floppy_modes() == 3 * 5 - 5 - 4  # a line has 5 rigid motions
    assert rope(beads=5).floppy_modes((0,)) == 3 * 4 - 2 - 4
    assert cube().floppy_modes() == cube().floppy_modes((0,)) == cube().floppy_modes((0, 4)) == 0
    far = cube().with_(positions=cube().positions + 1000.0)
    assert far.floppy_modes() == 0


@pytest.mark.parametrize("size", [1e-20, 1e-9, 1e9, 1e20])
def test_whether_a_body_can_change_shape_does_not_depend_on_its_size(size):
    body = cube(size)
    assert body.floppy_modes() == body.floppy_modes((0,)) == body.floppy_modes((0, 1)) == 0
    with pytest.raises(ValueError, match="5 zero-energy modes"):
        body.with_(springs=body.springs[:13], stiffness=1e5, damping=0.0, lengths=None)
    rates, _ = vibrations(body)
    assert rates == pytest.approx(vibrations(cube())[0], rel=1e-9)


def test_rigidity_matrix_is_the_derivative_of_the_lengths():
    body = triangle()
    rng = np.random.default_rng(1)
    move = rng.normal(size=(3, 3))
    small = 1e-6
    first, second = body.springs.T

    def lengths(x):
        return np.linalg.norm(x[second] - x[first], axis=1)

    change = (lengths(body.positions + small * move) - lengths(body.positions - small * move)) / (2 * small)
    matrix = rigidity_matrix(body.positions, body.springs)
    assert np.abs(change).max() > 0.1
    # central difference: error of order small² |move|³ / L² and of round-off eps L / small
    assert np.tensordot(matrix, move, 2) == pytest.approx(change, abs=1e-8)
    assert np.abs(np.tensordot(matrix, rigid_motions(body.positions), 2)).max() < 1e-14


def test_parts():
    body = top()
    assert body.particle("crown") == 12
    with pytest.raises(KeyError, match="it has ring, crown, tip"):
        body.particle("hat")
    with pytest.raises(ValueError, match="'ring' of body 'top' is 12 particles"):
        body.particle("ring")


def test_repr_is_complete():
    text = repr(top())
    for word in (
        "'top'",
        "14 particles of 0.5…3 kg",
        "12 kg in all",
        "37 springs of 1e+06 N/m",
        "100 kg/s",
        "tip",
    ):
        assert word in text
    assert "floppy" not in text
    assert "floppy" in repr(rope())


def test_a_single_particle_is_a_body():
    ball = Body("ball", [[1, 2, 3]], [2.0], np.zeros((0, 2)), 1.0, 0.0)
    assert ball.centre.tolist() == [1, 2, 3]
    assert not ball.inertia().any()
    assert ball.markers == (0, 0, 0)
    assert "1 particles of 2 kg" in repr(ball)
    assert "no springs" in repr(ball)


def test_size_and_inertia_by_hand() -> None:
    """Masses of 1 and 3 kg, 4 m apart: the centre is 3 m from the first, which is the farthest."""
    body = Body("dumbbell", np.array([[0.0, 0, 0], [4.0, 0, 0]]), [1.0, 3.0], [(0, 1)], 1e3, 0.0)
    assert (body.size, body.swept) == (pytest.approx(4.0), pytest.approx(6.0))
    assert body.with_(radius=0.5).size == pytest.approx(5.0)
    assert (top().size, top().swept) == (pytest.approx(math.sqrt(1.25)), pytest.approx(1.5))
    across = 1 * 3.0**2 + 3 * 1.0**2
    np.testing.assert_allclose(body.inertia(), np.diag([0.0, across, across]), atol=1e-14)
    np.testing.assert_allclose(inertia(body.positions, body.masses), np.diag([0.0, 48.0, 48.0]), atol=1e-14)
