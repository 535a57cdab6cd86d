"""Contact, from what is near what to the impulses that it gives.

The walk of a contact, a module a station: `pairs` has the bodies that may meet, `search` keeps `lists` of
which of their features are near each other, and `features` puts the contacts into `rows`; so does `ground`,
of particles, and of round features (`round`), that are near `surfaces`. `solver` finds their impulses by the
one `law`, with the friction of `cone`; `movers` knows what they move: particles, bodies that turn as one, and
rigid bodies; `friction` keeps the angular momentum where faces of particles rub. Impulses start from those of
the last node, see `warm`. `totals` has what is told of each pair. The arrays of all this are declared in
`records`.

Particles at surfaces, in scenes whose bodies neither collide nor roll, go a short way of their own: `points`.
`overlap` tells by geometry alone whether bodies are shown in each other.

The node of a step, in which all this acts, is `springgym.integrators.rows`, `springgym.rigid.node` for rigid
bodies, and `springgym.integrators.node` for `points`.
"""
