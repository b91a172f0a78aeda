"""Frames as they come, with their grasps, in the browser: `frames` watches a folder, `shown` draws with viser.

viser is a web page that this process serves; of rerun, which could do the same, one platform's package has 170 MB, of
viser 4 MB. The paper has no part in this.
"""
