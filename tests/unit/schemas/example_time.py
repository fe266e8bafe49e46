"""When the examples were measured."""

T_NS = 1_465_211_424_700_000_000
