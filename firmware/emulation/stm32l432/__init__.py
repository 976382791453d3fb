"""A model of the STM32L432KC that runs the very image that is flashed.

The core is Unicorn's; the peripherals are modelled here as far as the firmware uses them, by the
reference manual RM0394. Time is counted in cycles of 80 MHz: one for each instruction, and what the
core sleeps. Nothing depends on the machine that it runs on: the same orders give the same bytes.
"""
