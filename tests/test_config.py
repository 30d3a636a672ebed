"""Options: what is saved comes back; what is wrong is named, with the nearest name there is."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.config import METHODS, Config, JoinOptions, SplitOptions, config_from, read_config, to_table, write_config
from teamslam.errors import InputError
from teamslam.joining import ORDERS
from teamslam.model import LOSSES, Loss
from teamslam.solver import RULES
from teamslam.solver import Options as SolverOptions

positive = st.floats(1e-12, 1e12)
scalars = st.one_of(st.booleans(), st.integers(-(2**62), 2**62), st.floats(allow_nan=False), st.text(max_size=8))
joins = st.builds(JoinOptions, order=st.sampled_from(list(ORDERS)), gap=positive) | st.builds(
    JoinOptions, exact=st.just(True), gap=positive
)
configs = st.builds(
    Config,
    read=st.dictionaries(st.text("abc_", min_size=1, max_size=6), scalars, max_size=3),
    loss=st.none() | st.builds(Loss, name=st.sampled_from(list(LOSSES)), scale=positive),
    split=st.builds(
        SplitOptions, poses_per_piece=st.none() | st.integers(2, 10**6), heading_sigma=st.none() | positive
    ),
    solver=st.builds(
        SolverOptions,
        rule=st.sampled_from(list(RULES)),
        max_iterations=st.integers(1, 10**6),
        decrement=positive,
    ),
)
configs = st.builds(replace, configs, join=joins) | st.builds(
    replace, configs, method=st.sampled_from(METHODS), join=joins.filter(lambda join: not join.exact)
)


@given(config=configs)
def test_every_config_survives_its_table(config: Config) -> None:
    """config_from(to_table(c)) == c."""
    assert config_from(to_table(config)) == config


@given(config=configs)
def test_every_config_survives_its_file(config: Config, tmp_path_factory: pytest.TempPathFactory) -> None:
    """read_config(write_config(c)) == c."""
    path = tmp_path_factory.getbasetemp() / "config.toml"
    write_config(config, path)
    assert read_config(path) == config


def test_the_example_in_the_documentation_is_valid(tmp_path: Path) -> None:
    """The TOML at the top of the module is what the reader takes."""
    import teamslam.config

    lines = (teamslam.config.__doc__ or "").splitlines()
    path = tmp_path / "config.toml"
    path.write_text("\n".join(line for line in lines if line.startswith("    ")))
    config = read_config(path)
    assert config.method == "join" and config.loss == Loss("huber", 2.0) and config.split.poses_per_piece == 200


def test_an_empty_file_gives_the_defaults(tmp_path: Path) -> None:
    """What a file does not mention keeps its default."""
    path = tmp_path / "config.toml"
    path.write_text("")
    assert read_config(path) == Config()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('metod = "join"', ["metod", "did you mean 'method'?"]),
        ('method = "joined"', ["unknown method 'joined'", "join, full"]),
        ("[solver]\nmax_iteration = 5", ["solver.max_iteration", "did you mean 'max_iterations'?"]),
        ("[solver]\nmax_iterations = 'many'", ["solver.max_iterations", "int", "str"]),
        ("[solver]\nmax_iterations = 0", ["max_iterations", "at least 1"]),
        ("[solver]\nrule = 'newton'", ["newton", "gauss_newton"]),
        ("[join]\norder = 'treee'", ["treee", "tree"]),
        ("[loss]\nname = 'hubert'", ["hubert", "huber"]),
        ("[loss]\nname = 'huber'\nscale = -1", ["scale", "-1"]),
        ("[split]\nposes_per_piece = 1", ["at least 2 poses", "1"]),
        ("[split]\nheading_sigma = 0", ["heading_sigma", "above 0"]),
        ("loss = 3", ["loss", "int"]),
        ("[zzz]\na = 1", ["zzz", "known are"]),
        ("[loss]\nname = 'huber'\nscale = inf", ["scale", "inf"]),
        ("[join]\ngap = nan", ["gap is above 0", "nan"]),
        ('method = "full"\n[join]\nexact = true', ["full least squares is exact", "leave out"]),
        ('[join]\nexact = true\norder = "tree"', ["all at once", "'tree'"]),
        ("method = = 3", ["not valid TOML", "line 1"]),
        ("wrong = .05", ["not valid TOML", "line 1", "0.05"]),
        ("wrong = [1.0, -.5]", ["not valid TOML", "line 1", "0.5"]),
    ],
)
def test_a_wrong_option_is_named_with_its_cure(tmp_path: Path, text: str, words: list[str]) -> None:
    """The file, the key and what to do instead."""
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_config(path)
    for word in [*words, str(path)]:
        assert word in str(caught.value)


def test_a_missing_or_binary_file_is_an_input_error(tmp_path: Path) -> None:
    """Not a traceback from the depth of a library."""
    with pytest.raises(InputError, match="no such file"):
        read_config(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="byte 0 is no text; expected a text file"):
        read_config(tmp_path / "binary.toml")
