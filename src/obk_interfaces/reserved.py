"""Words that may not name a field: the generated C, C++ or Python would not compile."""

import keyword

__all__ = ["languages_reserving"]

# Source: ISO/IEC 9899:2011, 6.4.1 (those that are lower case)
_C = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while".split()
)

# Source: ISO/IEC 14882:2017, 5.11, with the alternative tokens of table 6
_CPP = frozenset(
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t char32_t "
    "class compl const const_cast constexpr continue decltype default delete do double "
    "dynamic_cast else enum explicit export extern false float for friend goto if inline int long "
    "mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public "
    "register reinterpret_cast return short signed sizeof static static_assert static_cast struct "
    "switch template this thread_local throw true try typedef typeid typename union unsigned using "
    "virtual void volatile wchar_t while xor xor_eq".split()
)


def languages_reserving(word: str) -> tuple[str, ...]:
    """Return the languages in which the word is a keyword."""
    languages = (("C", _C), ("C++", _CPP), ("Python", frozenset(keyword.kwlist)))
    return tuple(language for language, words in languages if word in words)
