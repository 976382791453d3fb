"""Models of the STM32L432KC and of the STM32G491RE that run the images that are flashed, unmodified.

The core is Unicorn's. The peripherals are modelled here as far as the firmware uses them, after the reference
manuals RM0394 and RM0440; a chapter number without a manual is RM0394's. Time is counted in cycles at 80 MHz: one
per instruction, plus the time that the core sleeps. No result depends on the host: the same orders give the same
bytes.
"""
