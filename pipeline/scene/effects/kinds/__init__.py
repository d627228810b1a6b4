"""The effects, a module each, all of the same shape: laws as functions, then `EFFECT`, an `EffectKind`."""
