"""The muscles of the face as data: thesis 2.3.1's seven pairs, and the others that speech needs.

Anchors are landmarks (thesis A.1) with offsets in mm: (lateral, up, forward).
"""

from shared_model.anatomy.muscles import Anchor, LinearMuscle, Muscle, SheetMuscle, SphincterMuscle

# The seven pairs of thesis 2.3.1.
ZYGOMATIC_MAJOR = LinearMuscle(
    name="zygomatic major",
    attachment=Anchor("zy", (-8, 7, 27)),
    insertion=Anchor("ch", (0, -7, -4)),
    zone_deg=32,
    start_mm=64,
    end_mm=116,
    pull_mm=13.0,
    bulge_mm=5.0,
)
ANGULI_DEPRESSOR = LinearMuscle(
    name="anguli depressor",
    attachment=Anchor("ch", (16, -50, -2)),
    insertion=Anchor("ch", (9, 0, -5)),
    zone_deg=48,
    start_mm=52,
    end_mm=92,
    pull_mm=8.0,
)
FRONTALIS_INNER = SheetMuscle(
    name="frontalis inner",
    centre=Anchor("sci", (-17, -6, 8)),
    direction=(0.0, 1.0, 0.1),
    width_mm=33,
    height_mm=(34, 13),
    pull_mm=7.0,
)
FRONTALIS_MAJOR = SheetMuscle(
    name="frontalis major",
    centre=Anchor("sci", (0, -5, -5)),
    direction=(0.0, 1.0, -0.1),
    width_mm=38,
    height_mm=(34, 13),
    pull_mm=7.0,
)
FRONTALIS_OUTER = SheetMuscle(
    name="frontalis outer",
    centre=Anchor("sci", (14, -8, -9)),
    direction=(0.0, 1.0, -0.2),
    width_mm=20,
    height_mm=(38, 13),
    pull_mm=7.0,
)
LATERAL_CORRUGATOR = LinearMuscle(
    name="lateral corrugator",
    attachment=Anchor("n", (10, -6, 0)),
    insertion=Anchor("sci", (-6, -2, 4)),
    zone_deg=78,
    start_mm=34,
    end_mm=64,
    pull_mm=6.0,
)
NASI_LABII = LinearMuscle(
    name="nasi labii",
    attachment=Anchor("en", (-6, 15, 4)),
    insertion=Anchor("al", (8, -4, 0)),
    zone_deg=38,
    start_mm=50,
    end_mm=76,
    pull_mm=7.0,
)

# The sphincters.
ORBICULARIS_ORIS = SphincterMuscle(
    name="orbicularis oris",
    centre=Anchor("sto", (0, -1, -6)),
    reach_mm=(46, 36, 48),
    squeeze=(0.42, 0.05),
    protrude_mm=9.0,
)
ORBICULARIS_OCULI = SphincterMuscle(
    name="orbicularis oculi",
    centre=Anchor("ex", (-4, 2, 4)),
    reach_mm=(34, 38, 45),
    squeeze=(0.15, 0.36),
)

# Depressors of the brow that help the corrugators (AU4), and the lips' own muscles (AU10, 16, 20).
PROCERUS = SheetMuscle(
    name="procerus",
    centre=Anchor("on", (0, -8, 0)),
    direction=(0.0, -1.0, 0.0),
    width_mm=22,
    height_mm=(24, 24),
    pull_mm=4.0,
)
DEPRESSOR_SUPERCILII = SheetMuscle(
    name="depressor supercilii",
    centre=Anchor("sci", (-2, -2, -5)),
    direction=(-0.45, -1.0, 0.2),
    width_mm=50,
    height_mm=(38, 20),
    pull_mm=6.5,
)
RISORIUS = LinearMuscle(
    name="risorius",
    attachment=Anchor("go", (6, -15, 38)),
    insertion=Anchor("ch", (-4, 3, 2)),
    zone_deg=42,
    start_mm=36,
    end_mm=84,
    pull_mm=8.0,
)
LEVATOR_LABII = SheetMuscle(
    name="levator labii",
    centre=Anchor("sto_upper", (12, 4, -4)),
    direction=(0.35, 1.0, 0.0),
    width_mm=24,
    height_mm=(34, 18),
    pull_mm=6.0,
)
DEPRESSOR_LABII = SheetMuscle(
    name="depressor labii",
    centre=Anchor("sto_lower", (10, -3, -4)),
    direction=(0.2, -1.0, 0.0),
    width_mm=24,
    height_mm=(18, 30),
    pull_mm=9.0,
)

MUSCLES: tuple[Muscle, ...] = (
    ZYGOMATIC_MAJOR,
    ANGULI_DEPRESSOR,
    FRONTALIS_INNER,
    FRONTALIS_OUTER,
    FRONTALIS_MAJOR,
    LATERAL_CORRUGATOR,
    NASI_LABII,
    ORBICULARIS_ORIS,
    ORBICULARIS_OCULI,
    PROCERUS,
    DEPRESSOR_SUPERCILII,
    RISORIUS,
    LEVATOR_LABII,
    DEPRESSOR_LABII,
)
# On the midline there is one muscle, not a pair.
UNPAIRED: tuple[Muscle, ...] = (ORBICULARIS_ORIS, PROCERUS)
