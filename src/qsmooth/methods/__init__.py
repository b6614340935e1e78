"""The methods, a module each; those that sweep share `driver`. `qsmooth.registry` finds them."""
