"""The environments, one file each; `springgym.registration` has the table of them."""
