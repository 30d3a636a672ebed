"""A submap as fields of a message, to the bit or rounded within a stated bound."""

from dataclasses import replace

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import (
    Kind,
    Layout,
    Submap,
    Values,
)
from teamslam.model.sparse import sp
from teamslam.wire.codec_places import (
    get_known,
    get_names,
    get_pairs,
    get_places,
    get_sources,
    inside,
    put_known,
    put_names,
    put_pairs,
    put_places,
    put_sources,
)
from teamslam.wire.codec_tables import get_rows, get_tables, put_rows, put_tables
from teamslam.wire.packing import Reader, Writer
from teamslam.wire.rounding import (
    FORMS,
    Precision,
    RoundedInformation,
    coupled_pairs,
    mirrored,
    number_of_integers,
    numbers_at,
    restore_estimate,
    restore_information,
    round_estimate,
    round_information,
    upper_places,
)

FORM_CODES = ("exact", *FORMS)


def put_submap(out: Writer, submap: Submap, precision: Precision) -> Precision:
    """Write a submap; returns the bound that its rounding keeps."""
    known = np.unique(np.concatenate([submap.keys, *(t.keys.ravel() for t in submap.raw)]))
    put_known(out, known)
    out.text(submap.id)
    out.number(submap.version)
    out.number(int(np.searchsorted(known, submap.base)))
    out.number(submap.base_dim)
    for real in (submap.cost, submap.chi2):
        out.real(real)
    out.number(submap.rows)
    put_names(out, submap.names, known, submap.sources)
    put_sources(out, submap.sources)
    layout = submap.values.layout
    for kind in Kind:
        put_places(out, np.searchsorted(known, layout.keys_of(kind)))
    pairs = coupled_pairs(layout, submap.information)
    put_pairs(out, len(layout), pairs)
    if submap.raw:  # two shifts, which add up in quadrature
        precision = replace(precision, shift_sigma=precision.shift_sigma * np.sqrt(0.5))
    kept = _put_information(out, layout, pairs, submap.information, precision.information)
    shift = _put_estimate(out, submap.values, submap.information, precision.shift_sigma)
    raw = put_tables(out, submap.raw, known, precision)
    return Precision(shift, kept).beside(raw)


def get_submap(source: Reader) -> Submap:
    """Read a submap. Raises InputError or ModelError where it makes no sense."""
    known = get_known(source)
    id_, version, base, base_dim = source.text(), source.number(), source.number(), source.number()
    cost, chi2, rows = source.real(), source.real(), source.number()
    names, sources = get_names(source), get_sources(source)
    keys = [known[get_places(source, len(known))] for _ in Kind]
    layout = Layout(np.concatenate(keys), np.repeat([int(k) for k in Kind], [len(k) for k in keys]))
    pairs = get_pairs(source, len(layout))
    information = _get_information(source, layout, pairs)
    return Submap(
        id=id_,
        version=version,
        base=int(known[inside(base, len(known))]),
        base_dim=base_dim,
        values=_get_estimate(source, layout),
        information=information,
        sources=sources,
        names=names,
        raw=get_tables(source, known),
        cost=cost,
        chi2=chi2,
        rows=rows,
    )


def _put_information(out: Writer, layout: Layout, pairs: IntArray, information: sp.csr_array, eta: float) -> float:
    """The shortest form that keeps the bound; exact numbers where none does."""
    exact = Writer()
    exact.reals(numbers_at(information, upper_places(layout, pairs)))
    candidates = [(exact.content(), "exact", 0.0)]
    for rounded in round_information(layout, pairs, information, eta) if eta else ():
        _, groups = number_of_integers(layout, pairs, rounded.form)
        body = Writer()
        body.integers(rounded.exponents)
        body.integers(rounded.integers, groups)
        candidates.append((body.content(), rounded.form, eta))
    data, form, bound = min(candidates, key=lambda c: len(c[0]))
    out.number(FORM_CODES.index(form))
    out.raw(data)
    return bound


def _get_information(source: Reader, layout: Layout, pairs: IntArray) -> sp.csr_array:
    form = FORM_CODES[inside(source.number(), len(FORM_CODES))]
    if form == "exact":
        places = upper_places(layout, pairs)
        return mirrored(layout.dof, places, source.reals(len(places[0])))
    exponents = source.integers(layout.dof)
    count, groups = number_of_integers(layout, pairs, form)
    return restore_information(layout, pairs, RoundedInformation(form, exponents, source.integers(count, groups)))


def _put_estimate(out: Writer, values: Values, information: sp.csr_array, limit_sigma: float) -> float:
    out.number(int(limit_sigma > 0.0))
    if not limit_sigma:
        for kind in Kind:
            put_rows(out, values.table(kind), kind)
        return 0.0
    integers, exponents, shift = round_estimate(values, information, limit_sigma)
    for kind in Kind:
        at = values.layout.unknowns(values.layout.keys_of(kind))
        out.columns(integers[at].reshape(-1, kind.dof))
        out.columns(exponents[at].reshape(-1, kind.dof))
    return shift


def _get_estimate(source: Reader, layout: Layout) -> Values:
    if not source.number():
        rows = [get_rows(source, len(layout.keys_of(kind)), kind) for kind in Kind]
        return Values(layout, np.concatenate([r.ravel() for r in rows]))
    integers, exponents = np.zeros(layout.dof, np.int64), np.zeros(layout.dof, np.int64)
    for kind in Kind:
        keys = layout.keys_of(kind)
        at = layout.unknowns(keys)
        integers[at] = source.columns(len(keys), kind.dof).ravel()
        exponents[at] = source.columns(len(keys), kind.dof).ravel()
    return restore_estimate(layout, integers, exponents)
