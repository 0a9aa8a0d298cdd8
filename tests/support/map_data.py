"""Entries of map files."""

POINT = {"id": "P", "face": "deck", "position": [0, 0, 0], "normal": [0, 0, 1], "rail": [1, 0, 0]}


SEGMENT = {"id": "S", "face": "aft", "start": [0, 1, 0], "end": [0, 1, 1], "normal": [0, -1, 0]}


RAIL = {"id": "H", "face": "deck", "min": [4, 0, 0], "max": [5, 1, 1]}


BOX = {"id": "B", "min": [6, 0, 0], "max": [7, 1, 1]}
