"""Why parts of finite-element models are not read, by their names in Abaqus, Nastran and ANSYS."""

_REASONS: dict[str, tuple[str, ...]] = {
    "give [[ties]]": ("BGPARM", "CEINTF"),
    "give [[contacts]] with against": (
        *("CONTACT", "BCTABLE", "BCTPARM", "BSURF", "BCPROP"),
        *("BCPROPS", "BCONP", "BCBODY", "BCBODY1", "BCTABL1", "BLSEG", "BFRIC", "CGAP"),
    ),
    "give [cyclic]": (
        *("CYCLIC SYMMETRY MODEL", "SELECT CYCLIC SYMMETRY MODES", "CYSYM", "CYJOIN", "CYSUP"),
        *("CYAX", "LOADCYH", "LOADCYN", "LOADCYT", "CYCLIC", "CYCOPT", "CYCFREQ", "CPCYC"),
    ),
    "give [[bolts]]": ("BOLT", "BOLTFOR", "BOLTFRC", "PTSECT", "SLOAD"),
    "temperatures are not supported": (
        *("TEMPERATURE", "EXPANSION", "TEMP", "TEMPD", "TREF", "BF", "BFE", "MP,ALPX"),
        *("BFBLOCK", "DFLUX", "DSFLUX", "FILM", "SFILM"),
    ),
    "materials are elastic": (
        *("PLASTIC", "HYPERELASTIC", "HYPERFOAM", "USER MATERIAL", "VISCOELASTIC", "MATS1"),
        *("MATHP", "PLSOLID", "TB,PLAS", "TB,BISO", "TB,HYPE", "TB,PRONY"),
    ),
    "constants do not depend on the temperature": ("MATT1", "TABLEM1", "TABLEM2"),
    "loads of a deck are static": ("DLOAD", "TLOAD1", "TLOAD2", "RLOAD1", "RLOAD2"),
    "springs lie between a node and the ground": ("CBUSH", "CELAS3", "CELAS4", "CONNECTOR SECTION"),
    "give [damping]": ("DAMPING", "TABDMP1", "GLOBAL DAMPING", "DMPRAT", "ALPHAD", "BETAD"),
    "give [rotation]": ("OMEGA", "CMOMEGA", "RFORCE", "DLOAD CENTRIF", "DLOAD CENT"),
    "give a [[loads]] with a pressure on a group": (
        *("SFE", "SFEBLOCK", "SF", "SFA", "SFL", "SFBLOCK", "PLOAD", "PLOAD2", "DSLOAD P"),
    ),
    "pressures do not depend on the place": ("SFGRAD", "DLOAD HP", "DSLOAD HP"),
    "give a [[loads]] with a force and a direction on a group": (
        *("DSLOAD TRVEC", "DSLOAD TRSHR", "FORCE2"),
    ),
    "give a [[loads]] with an acceleration": (
        "DLOAD BX",
        "DLOAD BY",
        "DLOAD BZ",
        "ACCEL",
        "ACCEL1",
    ),
    "a scene has no equations between displacements": (
        *("CP", "CPNGEN", "CPINTF", "CEBLOCK", "CERIG"),
    ),
    "loads on beams are not supported": ("PLOAD1",),
}

REASONS = {name: reason for reason, names in _REASONS.items() for name in names}
"""The reasons by name."""


def said(shown: str, name: str) -> str:
    """What is not read, and why if there is a reason.

    Args:
        shown: what is not read, in a few words.
        name: its name.
    """
    return f"{shown} ({REASONS[name]})" if name in REASONS else shown
