"""The kinds of experiment by name: in which of them an effect shows, and what must be known then."""

#: Effect -> the kinds of experiment in which it shows; those in the air show in `FLYING`.
SCENARIOS: dict[str, tuple[str, ...]] = {
    "rolling_resistance": ("roll",),
    "spin_friction": ("spin",),
    "viscous_friction": ("puck",),
    "anisotropic_friction": ("puck",),
    "moving_ground": ("puck",),
    "adhesion": ("puck",),
    "restitution": ("bounce",),
    "off_center_mass": ("cube",),
    "pair_attraction": ("pair",),
    "hidden_obstacle": ("throw",),
    "tilted_gravity": ("throw", "throw", "cube", "pair", "puck", "roll", "carom"),
}
FLYING = ("throw", "throw", "throw", "cube", "pair")
BOUNCING = "bounce"
EVERY = ("throw", "bounce", "cube", "pair", "puck", "roll", "spin", "carom")
ON_THE_GROUND = ("puck", "roll", "carom")  # from the start, with positions that show the effect
MUST_BE_KNOWN = {"rolling_resistance": "rolling_friction", "restitution": "damping", "adhesion": "sliding_friction"}
"""Effect -> the contact number that, left free, would be the effect by another name."""
