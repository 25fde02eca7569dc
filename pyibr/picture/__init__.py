"""The picture: what things draw themselves into, in which light."""
