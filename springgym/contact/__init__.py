"""Contact, from what is near what to the impulses that it gives.

The walk of a contact between two bodies, a module a station: `pairs` has the bodies that may meet, `search`
keeps `lists` of which of their features are near each other, `features` puts the contacts into `rows`,
`solver` finds their impulses by the one `law`, and `friction` theirs along the faces. Impulses move bodies of
springs through their particles, spheres that turn as `spheres` says, and rigid bodies as `solids` does. Among
many bodies they start from those of the last node, see `warm`. `totals` has what is told of each pair. The
arrays of all this are declared in `records`.

At surfaces, `points` solves for what they give particles, and `round` for ellipsoids and disks, with the gaps
and normals of `surfaces`. `cone` is the law of friction. `overlap` tells by geometry alone whether bodies are
shown in each other.

The node of a step, in which all this acts, is `springgym.integrators.node`, and `springgym.rigid.node` for
rigid bodies.
"""
