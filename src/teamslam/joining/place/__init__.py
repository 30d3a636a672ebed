"""Where each submap stands, in closed form, from what submaps share: no initial guess."""
