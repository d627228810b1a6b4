"""Effects: physical laws that a scene may have beside MuJoCo's usual ones, and what a recording may do to motion.

Each is a module of `kinds` with one `EFFECT`; adding one is adding a file there. See `kind.EffectKind`.
"""
