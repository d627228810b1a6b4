"""Physical effects: laws with names and parameters, added by one module each in `kinds`.

They import neither the discovery nor the hidden worlds: what those need of an effect stands in its `EffectKind`.
"""
