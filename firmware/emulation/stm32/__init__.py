"""Models of the STM32L432KC and of the STM32G491RE that run the very images that are flashed.

The core is Unicorn's; the peripherals are modelled here as far as the firmware uses them, by the
reference manuals RM0394 and RM0440; where a module names one chapter, it is of the first. Time is counted in cycles of 80 MHz: one for each instruction, and what the
core sleeps. Nothing depends on the machine that it runs on: the same orders give the same bytes.
"""
