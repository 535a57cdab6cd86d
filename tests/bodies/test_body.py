import math
import re

import numpy as np
import pytest

from springgym.bodies import Body, box, cube, rope, top
from springgym.bodies.body import rigid_motions, rigidity_matrix

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
        ({"positions": []}, "has no particles"),
        ({"positions": [[0, 0], [1, 0], [0, 1]]}, "positions of body 'triangle' must have shape (3, 3)"),
        ({"positions": [[0, 0, 0], [1, 0, math.nan], [0, 1, 0]]}, "positions[1]"),
        ({"positions": [[0, 0, 0], [0, 0, 0], [0, 1, 0]]}, "lengths[0] of body 'triangle' is 0.0"),
        ({"masses": [1, 2]}, "masses of body 'triangle' must have shape (3,)"),
        ({"masses": [1, 0, 3]}, "masses[1] of body 'triangle' is 0.0"),
        ({"masses": [1, 2, -3]}, "masses[2] of body 'triangle' is -3.0"),
        ({"masses": [math.nan, 2, 3]}, "masses[0] of body 'triangle' is nan"),
        ({"stiffness": [1, 0, 1]}, "stiffness[1] of body 'triangle' is 0.0"),
        ({"stiffness": [1, 1, math.inf]}, "stiffness[2] of body 'triangle' is inf"),
        ({"damping": [1, 1, -1]}, "damping[2] of body 'triangle' is -1.0"),
        ({"damping": math.nan}, "damping[0] of body 'triangle' is nan"),
        ({"lengths": [3, 0, 5]}, "lengths[1] of body 'triangle' is 0.0"),
        ({"springs": [(0, 1), (1, 3), (2, 0)]}, "spring 1 of body 'triangle' joins particles 1 and 3"),
        ({"springs": [(0, 1), (1, 2), (2, 2)]}, "spring 2 of body 'triangle' joins particle 2 to itself"),
        ({"springs": [(0, 1), (1, 2), (1, 0)]}, "spring 2 of body 'triangle' joins particles 1 and 0, which"),
        ({"springs": [(0, 1)]}, "nothing joins particle 2 to particle 0"),
        ({"springs": [(0, 1), (1, 2)]}, "can change shape in 1 ways"),
        ({"frame": (0, 1, 3)}, "frame of body 'triangle' names particle 3"),
        ({"parts": {"end": (5,)}}, "part 'end' of body 'triangle' names particle 5"),
        ({"parts": {"end": ()}}, "part 'end' of body 'triangle' has no particles"),
        ({"triangles": [(0, 1, 7)]}, "triangles of body 'triangle' names particle 7"),
    ],
)
def test_error_names_the_offender(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        triangle(**changes)


def test_a_body_cannot_be_changed():
    body = triangle()
    with pytest.raises(ValueError, match="read-only"):
        body.masses[0] = 5
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
    body, d = box((1.0, 0.7, 0.4), (0.2, 0.1, 0.1, 0.15, 0.1, 0.1, 0.15, 0.1)), np.array([0.3, -2.0, 1.0])
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


def test_weakening_a_top_is_noticed():
    whole = top(ring=6)
    kept = [s for s in range(len(whole.springs)) if 0 not in whole.springs[s] or s == 0]
    with pytest.raises(ValueError, match="can change shape in 2 ways"):
        whole.with_(springs=whole.springs[kept], stiffness=1e6, damping=0.0, lengths=whole.lengths[kept])


def test_rigidity_matrix_is_the_derivative_of_the_lengths():
    body, rng = triangle(), np.random.default_rng(1)
    move, small = rng.normal(size=(3, 3)), 1e-6
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
    assert ball.frame == (0, 0, 0)
    assert "1 particles of 2 kg" in repr(ball)
    assert "no springs" in repr(ball)
