from obelisk_spec.near import did_you_mean, list_names, near_names


def test_letter_case_does_not_count() -> None:
    assert near_names("OBKIMU", ["ObkImu", "other"]) == ("ObkImu",)


def test_what_exists_is_listed_where_nothing_is_near() -> None:
    assert did_you_mean("zzz", ["alpha", "beta"]) == "there is: `alpha`, `beta`"
    assert did_you_mean("alpa", ["alpha", "beta"]) == "did you mean `alpha`?"
    assert did_you_mean("alpa", []) is None


def test_a_long_list_is_cut_and_counted() -> None:
    assert list_names("abcdef", most=2) == "`a`, `b` and 4 more"
