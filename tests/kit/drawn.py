"""What property tests of several rooms draw from."""

from hypothesis import strategies as st

# All that UTF-8 can hold. `st.text()` asks the codec for each character there is, two seconds of a first run.
CHARACTERS = st.characters(exclude_categories=["Cs"])
