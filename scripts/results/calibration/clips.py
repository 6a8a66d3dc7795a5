"""The clips of the calibration set: what each one is, and which half it belongs to.

Each clip is a scene of the generator with a seed of its own and one level of every factor. Levels are dealt
so that each stands in both halves about equally often; nothing here was chosen by what a plan said of a clip.
"""

import random
from dataclasses import dataclass

# Levels of every factor; the first is the one in which nothing of the kind is wrong.
FACTORS = {
    "motion": ["none", "walkers", "far-walker", "none", "crowd", "foliage", "none", "walkers", "water"],
    "poses": ["exact", "jitter", "exact", "drift"],
    "exposure": ["fixed", "drift", "fixed", "flicker"],
    "surfaces": ["matte", "glossy"],
    "camera": ["walk", "yaw", "walk", "tumble"],
    "footage": ["clean", "noise", "clean", "compressed", "clean", "night"],
    "masks": ["none", "true", "missed"],
}
SCENES = ["street", "hall", "sprint"]
CLIPS_PER_HALF = 12
FRAMES = 40
FRAMES_PER_SECOND = 12
WIDTH = 256


@dataclass(frozen=True)
class Clip:
    """One clip. `half` is `set` where limits may be chosen on it, `unseen` where it only tests them."""

    name: str
    half: str
    scene: str
    seed: int
    motion: str
    poses: str
    exposure: str
    surfaces: str
    camera: str
    footage: str
    masks: str

    def truth(self):
        """What is there for a plan to find, by the name of what it decides on."""
        return {
            "motion": self.motion != "none",
            "exposure": self.exposure != "fixed",
            "poses": self.poses != "exact",
            "view-dependence": self.surfaces == "glossy",
        }


def clips():
    """All of them: each half deals every factor's levels anew, in an order of its own."""
    made = []
    for number, half in enumerate(["set", "unseen"]):
        dealt = {}
        for factor, levels in FACTORS.items():
            draw = random.Random(f"{half} {factor}")
            cards = [levels[(place + 5 * number) % len(levels)] for place in range(CLIPS_PER_HALF)]
            draw.shuffle(cards)
            dealt[factor] = cards
        for place in range(CLIPS_PER_HALF):
            name = f"{half}-{place:02}"
            scene, seed = SCENES[place % len(SCENES)], 1000 * (number + 1) + place
            levels = {factor: cards[place] for factor, cards in dealt.items()}
            made.append(Clip(name, half, scene, seed, **levels))
    return made
