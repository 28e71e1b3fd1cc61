"""A label that was changed after the sealing is found out."""

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.blind_effects.seal import SealBrokenError, canonical, new_salt, opened, root_of, seal_of

LABEL = {"kind": "single", "effects": [{"effect": "memory", "strength": 1.5}], "road": "corridor"}


def test_a_seal_is_the_hash_of_salt_and_sorted_label():
    text = 'salt{"effects":[{"effect":"memory","strength":1.5}],"kind":"single","road":"corridor"}'
    assert seal_of("salt", LABEL) == hashlib.sha256(text.encode()).hexdigest()


def test_order_of_keys_is_no_part_of_a_label():
    assert canonical(dict(reversed(LABEL.items()))) == canonical(LABEL)


def test_an_honest_key_opens():
    salt = new_salt()
    assert opened({"a": seal_of(salt, LABEL)}, {"a": {"salt": salt, "label": LABEL}}) == {"a": LABEL}


@given(st.floats(0.1, 3.0).filter(lambda value: value != 1.5))
def test_another_strength_does_not_open(strength: float):
    other = LABEL | {"effects": [{"effect": "memory", "strength": strength}]}
    with pytest.raises(SealBrokenError, match="not the one that was sealed"):
        opened({"a": seal_of("s", LABEL)}, {"a": {"salt": "s", "label": other}})


def test_a_case_without_a_key_does_not_open():
    with pytest.raises(SealBrokenError, match="expected a key"):
        opened({"a": seal_of("s", LABEL)}, {})


def test_salts_hide_equal_labels():
    assert seal_of(new_salt(), LABEL) != seal_of(new_salt(), LABEL)


def test_the_root_changes_with_any_case():
    assert root_of({"a": "1", "b": "2"}) == root_of({"b": "2", "a": "1"}) != root_of({"a": "2", "b": "1"})
