"""The effects, one module each: the law as functions, then `EFFECT`, an `EffectKind` with the module's name."""
