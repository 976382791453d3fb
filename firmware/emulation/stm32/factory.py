"""Factory calibration codes of the chip, and the board's present conditions (DS11451)."""

#: Codes of the voltage reference, and of the thermometer at 30 °C and 130 °C, by address.
REFERENCE_CODE, COLD_CODE, HOT_CODE = 0x1FFF_75AA, 0x1FFF_75A8, 0x1FFF_75CA
FACTORY = {REFERENCE_CODE: 1655, COLD_CODE: 1035, HOT_CODE: 1380}
FACTORY_V = 3.0

#: Present conditions of the board.
SUPPLY_V = 3.3
TEMPERATURE_C = 31.5
