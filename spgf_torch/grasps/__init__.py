"""Grasps that a model predicted, as one value: `grasps` is the sequence, `saving` writes it in every format, `page`
draws it on what was seen, `words` shows it where there is only text. The paper has no part in this.
"""
