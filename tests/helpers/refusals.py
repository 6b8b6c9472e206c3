import re

import pytest


def refused(call, field, *says):
    """Assert that `call` raises ValueError in one line with the field and these texts; return the error."""
    with pytest.raises(ValueError, match=re.escape(field)) as raised:
        call()
    message = str(raised.value).partition(" was raised from the environment creator")[0]  # the rest is Gymnasium's
    assert "\n" not in message
    assert not [part for part in says if part not in message], message
    return raised.value
