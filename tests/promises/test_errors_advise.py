"""What is wrong is refused in a sentence that names it, and what an error says that helps, helps."""

import re

import pytest
from parameters import but_slow
from refusals import ADVISED, LONG, REFUSED

import sdhj


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", but_slow(ADVISED, *LONG))
def test_advice_of_an_error_is_followed_once(name, tmp_path):
    pattern, wrong, followed = ADVISED[name]
    with pytest.raises(
        (ValueError, OSError, LookupError, TypeError, MemoryError, sdhj.NotAdmissible),
        match=re.compile(pattern, re.DOTALL),
    ):
        wrong(tmp_path)
    followed(tmp_path)


@pytest.mark.parametrize(("call", "named"), REFUSED)
def test_what_does_not_fit_is_told_in_a_sentence_that_names_it(call, named):
    with pytest.raises(ValueError, match=named) as raised:
        call()
    assert len(re.sub(r"file \S+,", "", str(raised.value))) < 600  # where the file lies does not count
