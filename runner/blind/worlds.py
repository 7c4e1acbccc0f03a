"""The kinds of systems that cases can be made of, by name."""

from __future__ import annotations

from runner.blind.drake_body.case import DrakeBodyMaker
from runner.blind.drake_box.case import DrakeBoxMaker
from runner.blind.make import AbstractMaker
from runner.blind.mechanism.case import SYSTEMS
from runner.blind.mechanism.maker import MechanismMaker
from runner.blind.planar_box.case import PlanarBoxMaker

MAKERS: dict[str, AbstractMaker] = {
    maker.system: maker
    for maker in (PlanarBoxMaker(), DrakeBoxMaker(), DrakeBodyMaker(), *map(MechanismMaker, SYSTEMS))
}
