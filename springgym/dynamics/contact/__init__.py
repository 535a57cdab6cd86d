"""Contact: the search for contacts, and their impulses.

The modules, in the order in which they compute contacts: `pairs` has the bodies that may touch; `search`
maintains `lists` of features that are near each other, and `features` makes contact `rows` of them; `ground`
does so for particles and round features (`round`) near `surfaces`. `solver` finds the impulses by one `law`,
with the friction of `cone`; `movers` applies them to particles, bodies that turn as one, and rigid bodies;
`friction` keeps the angular momentum where friction acts on faces of particles. Impulses start from those of
the last node, see `warm`. `totals` accumulates the results of each pair. `records` declares all arrays.

`points` has a shorter computation for particles at surfaces, in scenes whose bodies neither collide nor roll.
`overlap` checks by geometry alone whether bodies in a state overlap.

`springgym.dynamics.step` is the step in which all this acts.
"""
