"""Headings of columns in recorder files: names in several languages, with their units.

A heading is recognised by our name (``thrust_n``), by a usual name (``Time``, ``Zeit/s``, ``Axial force [kN]``), or by
words within a longer name (``CH3 Axialkraft Gehäuse (N)``).
"""

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from tripod_doe.errors import InputError, closest, option


@dataclass(frozen=True)
class Role:
    """A quantity that a column can hold."""

    telling: tuple[str, ...]  # names that also count within a longer heading
    plain: tuple[str, ...]  # names that count alone
    units: Mapping[str, float]  # factors to our unit, by units without spaces, dots and case


_TURN = 180 / math.pi
_LBF, _LBF_FT = 4.4482216152605, 1.3558179483314
_FORCE = {
    "n": 1.0, "newton": 1.0, "newtons": 1.0, "kn": 1e3, "dan": 10.0, "lbf": _LBF, "klbf": 1e3 * _LBF, "kip": 1e3 * _LBF,
    "kips": 1e3 * _LBF, "kgf": 9.80665, "kp": 9.80665,
}  # fmt: skip
_ANGLE = {
    "deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "grad": 1.0, "rad": _TURN, "mrad": _TURN / 1e3,
    "radian": _TURN, "radians": _TURN, "rev": 360.0, "revs": 360.0, "turns": 360.0, "umdr": 360.0,
}  # fmt: skip
_TIME = {"s": 1.0, "sec": 1.0, "sek": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9,
         "msec": 1e-3, "milliseconds": 1e-3, "usec": 1e-6, "microseconds": 1e-6,
         "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0, "days": 86_400.0,
         "hh:mm:ss": 1.0, "hh:mm": 1.0, "h:m:s": 1.0}  # fmt: skip
_MOMENT = {
    "nm": 1.0, "n-m": 1.0, "knm": 1e3, "mnm": 1e-3, "nmm": 1e-3, "ncm": 1e-2,
    **dict.fromkeys(("lbfft", "lbft", "ftlb", "ftlbf", "lbf-ft", "lb-ft", "ft-lb", "ft-lbf"), _LBF_FT),
    **dict.fromkeys(("lbfin", "lbin", "inlb", "inlbf", "lbf-in", "lb-in", "in-lb", "in-lbf"), _LBF_FT / 12),
}  # fmt: skip
_SPEED = {
    "rpm": 1.0, "1/min": 1.0, "u/min": 1.0, "r/min": 1.0, "rev/min": 1.0, "tr/min": 1.0, "min-1": 1.0, "/min": 1.0,
    "upm": 1.0, "giri/min": 1.0, "rev/s": 60.0, "rps": 60.0, "1/s": 60.0, "s-1": 60.0,
    "krpm": 1e3, "hz": 60.0, "rad/s": 30 / math.pi, "deg/s": 1 / 6, "°/s": 1 / 6,
}  # fmt: skip
ROLES = {
    "thrust_n": Role(
        ("thrust", "axial force", "axial thrust", "axialkraft", "axialkraefte", "schubkraft", "kraft axial",
         "force axiale", "effort axial", "fuerza axial", "forza assiale", "forca axial", "gaf",
         "generated axial force"),
        ("force", "kraft", "fax", "f ax", "f axial", "effort", "fuerza", "forza", "load cell", "kraftmessdose",
         "kraftaufnehmer", "capteur de force", "celda de carga", "cella di carico"),
        _FORCE,
    ),
    "rotation_deg": Role(
        ("rotation angle", "angle of rotation", "shaft angle", "drehwinkel", "wellenwinkel", "rotationswinkel",
         "angle de rotation", "angulo de giro", "angulo de rotacion", "angulo de rotacao", "angolo di rotazione",
         "encoder angle", "angular position"),
        ("rotation", "angle", "phi", "winkel", "encoder", "angulo", "angolo"),
        _ANGLE,
    ),
    "time_s": Role(
        ("time", "zeit", "messzeit", "temps", "tiempo", "tempo"),
        ("t", "timestamp", "timestamps", "time stamp", "x time"),
        _TIME,
    ),
    "tacho": Role(
        ("tacho", "tachometer", "tach", "keyphasor", "drehzahlimpuls", "drehzahlpuls", "impulse", "trigger",
         "drehzahlgeber", "speed pulse", "pulse train", "lichtschranke", "nullimpuls", "index pulse", "hall sensor",
         "top tour", "tachymetre", "tacometro", "contagiri"),
        ("pulse", "pulses", "impuls", "impulsion", "impulsions", "impulso", "impulsos", "impulsi", "hall", "marker",
         "z pulse", "once per rev"),
        {},
    ),
    "joint_angle_deg": Role(
        ("joint angle", "articulation angle", "bending angle", "operating angle", "beugewinkel", "gelenkwinkel",
         "knickwinkel", "angle de brisure", "angulo de articulacion", "angolo di snodo", "deflection angle"),
        ("articulation",),
        _ANGLE,
    ),
    "torque_n_m": Role(
        ("torque", "drehmoment", "moment of torsion", "couple", "coppia"),
        ("moment", "m", "md", "par", "last", "load torque"),
        _MOMENT,
    ),
    "speed_rpm": Role(
        ("speed", "shaft speed", "rotational speed", "rotation speed", "drehzahl", "vitesse de rotation",
         "velocidad de giro", "velocita di rotazione", "numero di giri"),
        ("rpm", "n", "vitesse", "regime", "velocidad", "velocita", "giri"),
        _SPEED,
    ),
}  # fmt: skip
"""Roles of columns by our names; the last three give the operating point, which may be stated elsewhere."""

_PHRASES = sorted(((-len(phrase), phrase, name) for name, role in ROLES.items() for phrase in role.telling))

OPERATING = ("joint_angle_deg", "torque_n_m", "speed_rpm")
"""Roles of optional columns."""

_LEVELS = {"v", "mv", "ttl"}
"""Units of a tachometer's signal, even if its heading says speed."""

_OWN, _NAMED, _LIKELY = range(3)  # how well a heading names a role
_COMPOUND = 7  # least letters of a name recognised within a longer word, as in Antriebsdrehmoment
_OPENING = {"]": "[", ">": "<", ")": "("}
_PIECES, _LONGEST_UNIT = 4, 15  # of a unit within a heading: pieces, as in hh:mm:ss, and characters
_SCALED = re.compile(r"(?:[/*×·]|\bx)\s*10+\b|\b10\s*\^")
"""A factor next to a unit, as in ``Force [N] / 1000``."""
_EXTREMES = re.compile(r"\b(?:rms|effektivwert|max|maximum|peak|spitze|limit|grenzwert)\b")
_WANTED = re.compile(r"\b(?:set ?point|soll|sollwert|command|demand|target|min|minimum|mean|mittelwert|average|avg)\b")
"""Words of a heading whose values are no samples of the signal, or only what the rig was to do."""
_APART = re.compile(r"\s+in\s+|[\s/,;:_\[\](){}<>|=-]+")


def plain_words(text: str) -> str:
    """A name without case, accents and signs between its words; ``AxialForce`` has two."""
    text = (
        re.sub(r"(?<=[a-zäöü]{2})(?=[A-ZÄÖÜ])", " ", text)
        .casefold()
        .replace("ä", "ae")
        .replace("ö", "oe")
        .replace("ü", "ue")
    )
    text = "".join(sign for sign in unicodedata.normalize("NFD", text) if not unicodedata.combining(sign))
    return " ".join(re.findall(r"[^\W_]+", text))


@lru_cache(maxsize=10_000)
def unit_key(unit: str) -> str:
    """A unit in the form of the keys of the unit tables."""
    return re.sub(r"[\s.·⋅*^]", "", unit.replace("⁻¹", "-1")).casefold().replace("μ", "µ")  # casefold makes it a mu


KNOWN_UNITS = {unit for role in ROLES.values() for unit in role.units}
_OTHER_UNITS = set(
    "v mv a ma - -- % 1 k °c degc °f bar mbar kpa mpa pa g m/s m/s2 mm µm um m w kw # count".split()  # noqa: SIM905
)
_NOT_CONVERTED = set("mn mv v lb lbs oz ozf tf gf kg psi ticks tick counts bits lsb krad gon arcmin arcsec 1/h".split())  # noqa: SIM905
"""Units that a heading without brackets may end in, and that are refused; no word of a name is among them."""
_NO_UNIT = re.compile(
    r"(?:(?:ch|chan|nr|no|[^\W\d_]{5,}) ?)?\d+|[xyz]|left|right|links|rechts|front|rear|vorn|hinten|"
    r"axial|housing|gehaeuse|raw|roh|mean|filtered|filt|gefiltert|measured|gemessen|actual|input|output|set"
)
"""What round brackets may hold apart from a unit: a number of a channel, a side."""


def is_unit(text: str) -> bool:
    """Whether a field below a heading is a possible unit of a record's column."""
    return unit_key(text.strip().strip("[]()<>").strip()) in KNOWN_UNITS | _OTHER_UNITS | _NOT_CONVERTED


def in_brackets(heading: str) -> tuple[str, str, str]:
    """A heading without the brackets at its end, the sign that opens them, and their text; both empty if none."""
    text = heading.strip()
    opening = _OPENING.get(text[-1:], "")
    at = text.rfind(opening, 0, -1) if opening else -1
    return (text, "", "") if at < 0 else (text[:at].rstrip(), opening, text[at + 1 : -1].strip())


def is_no_unit(text: str) -> bool:
    """Whether a text in round brackets names a channel or a side."""
    return _NO_UNIT.fullmatch(plain_words(text)) is not None


def name_and_unit(role: str, heading: str) -> tuple[str, str]:
    """Name and unit of a heading for a role; no unit if the heading has none.

    Text in brackets is a unit, unless round ones hold the number of a channel or a side. Text at the end is a unit if
    the role knows it, or if it can be nothing else; else text before it, as in ``Force [kN] filtered`` or ``kN force``.
    """
    name, opening, text = in_brackets(heading)
    if opening == "(" and is_no_unit(text):
        before, unit = name_and_unit(role, name)
        return f"{before} {text}", unit
    if opening:
        return name, text
    known = ROLES[role].units.keys() | _NOT_CONVERTED
    places = [(0, 0), *(apart.span() for apart in _APART.finditer(heading))]
    ends = [*places, (len(heading), len(heading))]
    units = [  # the last counts, the longest of those with the same end
        (stop, -begin, f"{heading[:start]} {heading[after:]}".strip())
        for at, (start, begin) in enumerate(places)
        for stop, after in ends[at + 1 : at + 1 + _PIECES]
        if stop - begin <= _LONGEST_UNIT and unit_key(heading[begin:stop]) in known
    ]
    if units:
        stop, minus_begin, name = max(units)
        return name, heading[-minus_begin:stop]
    within = re.search(r"[\[({<]([^\[({<\])}>]*)[\])}>]", heading)
    if within and is_unit(within[1]) and not is_no_unit(within[1]):
        return f"{heading[: within.start()].rstrip()}{heading[within.end() :]}", within[1]
    return heading, ""


def unit_factor(role: str, heading: str) -> float:
    """Factor for the values under a heading: 1 if the heading has no unit.

    Raises:
        InputError: If the heading has a unit that the role does not know, or a factor next to it.
    """
    units = ROLES[role].units
    if not units or heading == role:
        return 1.0
    unit = name_and_unit(role, heading)[1]
    factor = factor_of(role, unit) if unit else 1.0
    if factor is None:
        raise InputError(
            f"the unit of {heading!r} is not known; known are {', '.join(units)}; "
            f"{option('column', f'{role}={heading} [UNIT]')} names another one"
        )
    if (scaled := _SCALED.search(heading)) and not in_brackets(heading)[1]:  # a unit at the end is the last word
        raise InputError(
            f"{heading!r}: {scaled[0]!r} may be a factor of the values; "
            f"{option('column', f'{role}={heading} [UNIT]')} names the unit of the values as they are in the file"
        )
    return factor


def factor_of(role: str, unit: str) -> float | None:
    """Factor from a unit to the unit of a role; None if the role does not know it.

    Case decides between milli and mega only.
    """
    if unit == "mN" and role == "thrust_n":
        return 1e-3
    return None if unit.startswith("MN") else ROLES[role].units.get(unit_key(unit))


def _claims(heading: str) -> dict[str, int]:
    """The roles that a heading may name, and how well (smaller is better)."""
    parts = {role: name_and_unit(role, heading) for role in ROLES}
    names = {role: {plain_words(heading), plain_words(name)} for role, (name, _) in parts.items()}
    claims = {role: _OWN for role in ROLES if role in (heading, _without_unit(heading))}
    claims = claims or {role: _NAMED for role in ROLES if not names[role].isdisjoint(ROLES[role].telling)}
    claims = claims or {
        role: _LIKELY
        for role in ROLES
        if not names[role].isdisjoint(ROLES[role].plain)
        and (role not in OPERATING or factor_of(role, parts[role][1]))  # n may be anything, n [rpm] is a speed
    }
    if not claims and len(within := _roles_within(plain_words(heading))) == 1:
        (role,) = within
        name = plain_words(parts[role][0])
        if not _EXTREMES.search(name) and (role in OPERATING or not _WANTED.search(name)):
            claims = {role: _LIKELY}
    if "speed_rpm" in claims and unit_key(parts["speed_rpm"][1]) in _LEVELS:
        return {"tacho": claims["speed_rpm"]}
    return claims


def operating_name(heading: str) -> str:
    """Our name of the operating parameter that a whole heading names in some language; else empty."""
    return next((role for role, rank in _claims(heading).items() if role in OPERATING and rank == _NAMED), "")


def _roles_within(name: str) -> set[str]:
    """Roles that words within a name stand for; words of a longer phrase stand for nothing else."""
    roles = set()
    for _, phrase, role in _PHRASES:
        edge = "" if len(phrase) >= _COMPOUND and " " not in phrase else r"\b"
        shorter = re.sub(f"{edge}{re.escape(phrase)}{edge}", "|", name)
        if shorter != name:
            roles.add(role)
        name = shorter
    return roles


def roles_of(headings: Sequence[str], given: Mapping[str, str]) -> dict[str, int]:
    """Position of every recognised column, by our name of the column.

    Args:
        headings: Headings of the file.
        given: Headings by our names, as the user wrote them; an empty one for a column that is not used.

    Raises:
        InputError: If a given heading is missing, or two headings match a role equally well.
    """
    positions = {role: given_position(role, heading, headings) for role, heading in given.items() if heading}
    free = [place for place in range(len(headings)) if place not in positions.values()]
    claims = {place: _claims(headings[place]) for place in free}
    for role in ROLES.keys() - given.keys():
        ranked = [(claims[place][role], place) for place in free if role in claims[place]]
        best = min((rank for rank, _ in ranked), default=None)
        places = [place for rank, place in ranked if rank == best]
        if len(places) > 1 and role not in OPERATING:
            names = " or ".join(repr(headings[i]) for i in places)
            hint = option("column", f"{role}={headings[places[0]]}")
            raise InputError(f"{names} may be {role}: choose one, for instance {hint}")
        if len(places) == 1:
            positions[role] = places[0]
    return {role: positions[role] for role in ROLES if role in positions}


def given_position(role: str, given: str, headings: Sequence[str]) -> int:
    """Position of the heading that a user named: an exact match, or a match without unit, case and signs."""
    for named in (given, _without_unit(given)):
        if named in headings:
            return headings.index(named)
    for form in (_without_unit, plain_words):
        places = [place for place, heading in enumerate(headings) if form(heading) == form(given)]
        places = places or [
            place for place, heading in enumerate(headings) if form(_without_unit(heading)) == form(given)
        ]
        if len(places) == 1:
            return places[0]
        if places:
            raise InputError(
                f"{option('column', f'{role}={given}')}: several headings have this name: "
                + ", ".join(repr(headings[place]) for place in places)
            )
    raise InputError(
        f"{option('column', f'{role}={given}')}: no such heading{closest(given, headings)}; the file has "
        + ", ".join(headings)
    )


def _without_unit(heading: str) -> str:
    return in_brackets(heading)[0]


def unit_given(heading: str, given: str | None) -> str:
    """A heading with the unit that the user wrote after it, if the heading has another unit or none."""
    unit = in_brackets(given or "")[2]
    return f"{_without_unit(heading)} [{unit}]" if unit and given != heading else heading


def parse_column(text: str) -> tuple[str, str]:
    """Our name of a column and its heading in a file, from ``NAME=HEADING``; an empty heading if it is not used.

    Raises:
        InputError: If the text has another form.
    """
    name, equals, heading = (part.strip() for part in text.partition("="))
    if not equals or name.replace("-", "_") not in ROLES:
        raise InputError(f"{option('column', text)}: write NAME=HEADING, a NAME of {', '.join(ROLES)}")
    return name.replace("-", "_"), heading
