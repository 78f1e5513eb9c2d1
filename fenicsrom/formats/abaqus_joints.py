"""Contacts, ties and pre-tension sections of Abaqus and CalculiX files."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from fenicsrom.formats.abaqus_couplings import NodesOf
from fenicsrom.formats.abaqus_sets import Keyword
from fenicsrom.formats.collector import Collector
from fenicsrom.formats.mesh_file import NEVER_SLIPS, DeckJoint

KEYWORDS = (
    *("TIE", "CONTACT PAIR", "SURFACE INTERACTION", "SURFACE BEHAVIOR", "FRICTION"),
    "PRE-TENSION SECTION",
)

CYCLIC = {"CYCLIC SYMMETRY", "MULTISTAGE"}
"""Parameters of *TIE that join the cut faces of a sector."""

GroupOf = Callable[[str], str | None]
"""Gives the group of a surface; None if the surface has neither facets nor nodes of the mesh."""


@dataclass(frozen=True)
class _Law:
    """A surface interaction.

    Attributes:
        friction: coefficient of friction.
        normal: pressure per overclosure; None if hard.
        tangential: shear stress per slip while the surfaces stick (CalculiX); None if rigid.
        tied: whether the surfaces never part.
    """

    friction: float = 0.0
    normal: float | None = None
    tangential: float | None = None
    tied: bool = False


@dataclass(eq=False)
class Reader:
    """Reads what joins two surfaces.

    Attributes:
        found: what was collected.
        laws: the surface interactions by name in capitals.
        current: name of the interaction whose data follow.
        joints: the contacts and ties, and the name of the interaction of each contact.
        tensioned: the surface of each pre-tension section by its node.
    """

    found: Collector
    laws: dict[str, _Law] = field(default_factory=dict)
    current: str = ""
    joints: list[tuple[DeckJoint, str]] = field(default_factory=list)
    tensioned: dict[int, str] = field(default_factory=dict)

    def take(
        self, keyword: Keyword, rows: list[list[str]], group_of: GroupOf, nodes_of: NodesOf
    ) -> bool:
        """Take one of KEYWORDS; whether it was understood.

        Raises:
            ValueError, IndexError, KeyError: it is damaged.
        """
        given = keyword.parameters
        if keyword.name == "SURFACE INTERACTION":
            self.current = given.get("NAME", "").upper()
            self.laws[self.current] = _Law()
        elif keyword.name == "SURFACE BEHAVIOR":
            return self._behave(given, rows)
        elif keyword.name == "FRICTION":
            return self._rub(given, rows)
        elif keyword.name == "PRE-TENSION SECTION":
            surface = given.get("SURFACE", given.get("ELEMENT", ""))
            self.tensioned |= dict.fromkeys(nodes_of(given["NODE"]).tolist(), surface)
        else:
            if keyword.name == "TIE" and CYCLIC & given.keys():
                self.found.leave("*TIE of the cut faces of a sector; give [cyclic]")
                for row in rows:
                    self.found.following |= set(nodes_of(row[0]).tolist())
                return True
            for row in rows:
                self._join(keyword, row, group_of)
            return bool(rows)
        return True

    def _behave(self, given: dict[str, str], rows: list[list[str]]) -> bool:
        kind = given.get("PRESSURE-OVERCLOSURE", "HARD").upper()
        law = self.laws.get(self.current)
        if law is None or kind not in ("HARD", "LINEAR", "TIED"):
            return False
        if kind != "HARD":
            law = replace(law, normal=float(rows[0][0]), tied=kind == "TIED")
        if "NO SEPARATION" in given:
            self.found.leave("*SURFACE BEHAVIOR, NO SEPARATION: the surfaces can part")
        self.laws[self.current] = law
        return True

    def _rub(self, given: dict[str, str], rows: list[list[str]]) -> bool:
        law = self.laws.get(self.current)
        if law is None or {"EXPONENTIAL DECAY", "USER", "ANISOTROPIC"} & given.keys():
            return False
        if "ROUGH" in given:
            self.laws[self.current] = replace(law, friction=NEVER_SLIPS)
            return True
        if len(rows) > 1:
            self.found.leave("the coefficients of *FRICTION after the first one")
        slope = float(rows[0][1]) if len(rows) == 1 and len(rows[0]) == 2 else None
        law = replace(law, friction=float(rows[0][0]), tangential=slope or None)
        self.laws[self.current] = law
        return True

    def _join(self, keyword: Keyword, row: list[str], group_of: GroupOf) -> None:
        given, what = keyword.parameters, f"*{keyword.name} {', '.join(row)}"
        if len(row) < 2 or row[0] == row[1] or not row[1]:
            self.found.leave(f"{what}: a surface touches itself")
            return
        pair = [group_of(name) for name in row[:2]]
        if None in pair:
            missing = row[pair.index(None)]
            self.found.leave(f"{what}: the surface {missing} has no facets or nodes of the solid")
            return
        tied = keyword.name == "TIE" or "TIED" in given
        reach = float(given.get("POSITION TOLERANCE", 0.0)) or None
        adjusted = "" if tied else given.get("ADJUST", "")
        within = float(adjusted) if re.match(r"[\d.]", adjusted) else None  # else a set of nodes
        shut = bool(adjusted) and within != 0.0
        if shut and within is not None:
            self.found.leave(f"{what}, ADJUST={adjusted}: gap = 0.0 closes larger gaps, too")
        joint = DeckJoint(what, *map(str, pair), tied=tied, reach=reach, shut=shut)
        self.joints.append((joint, "" if tied else given.get("INTERACTION", "").upper()))

    def finished(self) -> list[DeckJoint]:
        """The contacts and ties with what their interactions say."""
        found = []
        for joint, name in self.joints:
            law = self.laws.get(name, _Law())
            numbers = {key: getattr(law, key) for key in ("friction", "normal", "tangential")}
            found.append(replace(joint, **numbers, tied=joint.tied or law.tied))
        return found
