"""The muscles of the face as data: thesis 2.3.1's seven pairs, and the others that speech needs.

Anchors are landmarks (thesis A.1) with offsets in mm: (lateral, up, forward).
"""

from shared_model.muscles import Anchor, LinearMuscle, Muscle, SheetMuscle, SphincterMuscle

ZYGOMATIC_MAJOR = LinearMuscle(
    "zygomatic major", Anchor("zy", (-13, -6, 12)), Anchor("ch"), 50, 50, 92, 15.0, bulge_mm=3.0
)
ANGULI_DEPRESSOR = LinearMuscle(
    "anguli depressor", Anchor("ch", (4, -42, -4)), Anchor("ch"), 62, 38, 66, 8.0
)
FRONTALIS_INNER = SheetMuscle(
    "frontalis inner", Anchor("sci", (-18, -2, 6)), (0.0, 1.0, 0.1), 26, (45, 26), 7.0
)
FRONTALIS_MAJOR = SheetMuscle(
    "frontalis major", Anchor("sci", (2, -2, 0)), (0.0, 1.0, -0.1), 30, (45, 26), 7.5
)
FRONTALIS_OUTER = SheetMuscle(
    "frontalis outer", Anchor("sci", (15, -7, -8)), (0.05, 1.0, -0.3), 26, (42, 24), 7.0
)
LATERAL_CORRUGATOR = LinearMuscle(
    "lateral corrugator", Anchor("n", (8, 2, 0)), Anchor("sci", (-6, 0, 4)), 75, 22, 52, 7.0
)
NASI_LABII = LinearMuscle(
    "nasi labii", Anchor("en", (-6, 4, 4)), Anchor("al", (0, -6, 0)), 42, 36, 70, 6.0
)

# Orbicularis oculi, pars orbitalis: the outer brow down and in; the lids are `jaw_and_lids`'.
ORBICULARIS_OCULI = SphincterMuscle(
    "orbicularis oculi", Anchor("ps", (4, -4, 0)), (34, 38, 45), (0.12, 0.22)
)
PROCERUS = SheetMuscle("procerus", Anchor("g", (0, -2, 0)), (0.0, -1.0, 0.0), 22, (20, 24), 4.0)
ORBICULARIS_ORIS = SphincterMuscle(
    "orbicularis oris", Anchor("sto", (0, -1, -6)), (46, 36, 48), (0.42, 0.05), protrude_mm=9.0
)
RISORIUS = LinearMuscle("risorius", Anchor("go", (-10, 6, 18)), Anchor("ch"), 60, 42, 78, 9.0)
LEVATOR_LABII = SheetMuscle(
    "levator labii", Anchor("sto_upper", (12, 4, -4)), (0.35, 1.0, 0.0), 24, (34, 18), 6.0
)
DEPRESSOR_LABII = SheetMuscle(
    "depressor labii", Anchor("sto_lower", (10, -3, -4)), (0.2, -1.0, 0.0), 24, (18, 30), 5.0
)

MUSCLES: tuple[Muscle, ...] = (
    ZYGOMATIC_MAJOR,
    ANGULI_DEPRESSOR,
    FRONTALIS_INNER,
    FRONTALIS_OUTER,
    FRONTALIS_MAJOR,
    LATERAL_CORRUGATOR,
    NASI_LABII,
    ORBICULARIS_OCULI,
    ORBICULARIS_ORIS,
    PROCERUS,
    RISORIUS,
    LEVATOR_LABII,
    DEPRESSOR_LABII,
)
