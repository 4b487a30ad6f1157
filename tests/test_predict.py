"""Which files ``clearance.predict`` reads."""

from omegaconf import OmegaConf

from clearance.predict import files_of


def test_a_folder_is_all_recordings_in_it_by_name(tmp_path):
    for name in ("b.csv", "a.parquet", "a.yaml", "._a.parquet"):
        (tmp_path / name).write_text("")
    a, b = tmp_path / "a.parquet", tmp_path / "b.csv"
    assert files_of(str(tmp_path)) == [a, b]
    assert files_of(OmegaConf.create(["other.h5", str(tmp_path)])) == [files_of("other.h5")[0], a, b]
