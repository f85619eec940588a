"""Learning curves are drawn only from a whole table of a training."""

import json

import pytest

from pipeline.errors import ArtifactError
from pipeline.reporting.frames import read_curves

WHOLE = "epoch,train_loss,val_loss\n0,1.0,1.5\n1,0.5,0.75\n2,0.25,0.5\n"


@pytest.fixture(autouse=True)
def _metrics(tmp_path):
    (tmp_path / "metrics.json").write_text(json.dumps({"epochs": 3}))


def test_a_whole_table_is_read(tmp_path):
    """Every row is there, in order."""
    (tmp_path / "curves.csv").write_text(WHOLE)
    assert read_curves(tmp_path)["val_loss"].tolist() == [1.5, 0.75, 0.5]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "does not exist"),
        (b"", "not a readable table"),
        (b"\xff\xfe\x00\x01\x80", "not a readable table"),
        (WHOLE[:40].encode(), "has 2 rows"),
        (WHOLE.replace("0.75", "nan").encode(), "not all of them numbers"),
        (WHOLE.replace("0.75", "foo").encode(), "not all of them numbers"),
        (WHOLE.replace("val_loss", "loss").encode(), "missing columns"),
    ],
)
def test_what_is_not_one_is_refused(tmp_path, content, said):
    """A file that is missing, empty, foreign, cut off, or holds no numbers is refused by name."""
    if content is not None:
        (tmp_path / "curves.csv").write_bytes(content)
    with pytest.raises(ArtifactError, match=said) as refused:
        read_curves(tmp_path)
    assert "curves.csv" in str(refused.value)
