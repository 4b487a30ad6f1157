"""The diagnosis with an error planted in it: its law of gravity goes by the name of another effect.

``python planted.py recordings=[...] ...``, as ``python -m clearance.diagnose``.
"""

from dataclasses import replace

from clearance import diagnose
from clearance.diagnosis.hypotheses import effect_files

WRONG = {"gravity": "slider_offset"}


def mislabelled(names, without):
    effects = effect_files.load_effects(names, without)
    return tuple(replace(effect, name=WRONG.get(effect.name, effect.name)) for effect in effects)


if __name__ == "__main__":
    diagnose.load_effects = mislabelled
    diagnose.main()
