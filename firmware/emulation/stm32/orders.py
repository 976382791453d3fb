"""Orders of a test, one JSON object a line, and a report to each.

| order | what it does |
|---|---|
| {"run": s} | lets time pass |
| {"send": hex} | bytes on the serial line to the board, as fast as it carries them |
| {"cts": "low" / "high" / "open"} | clear to send, held up, nothing connected |
| {"converter": false} | conversions do not end any more |
| {"cut": [n, outcome]} | cuts the power at the n-th flash operation from now |
| {"power": true} | switches on again; the flash is as it was left |
| {"branch": true} | what follows is undone by the next "leave" |
| {"leave": true} | back to the state at "branch" |
| {"jump": address} | the core goes on there, as after a damaged return address |
| {"stack": address} | the stack pointer is there, as after so many calls |
| {"edges": [s, ...]} | the sync input rises after each of these times |
| {"flicker": [steps, hz]} | ambient light of this amplitude and frequency |
| {"rate": baud} | the rate of the other end; what is off by more than 4 % is not understood |
"""

import json
import os

from .flash import OUTCOMES
from .peripheral import HZ


def obey(board, requests, answers):
    """Reads orders until there are no more."""
    on, reported = True, 0
    for line in requests:
        order, value = next(iter(json.loads(line).items()))
        if order == "branch":
            # A copy of this process goes on; this one keeps the state and waits for its end.
            child = os.fork()
            if child:
                os.waitpid(child, 0)
        elif order == "leave":
            os._exit(0)
        elif order == "run":
            on = board.run(value) if on else False
        elif order == "send":
            board.usart.receive(bytes.fromhex(value), board.core.now)
        elif order == "cts":
            board.cts = value
        elif order == "converter":
            board.converter_works = value
        elif order == "cut":
            operation, outcome = value
            if outcome not in OUTCOMES:
                raise SystemExit(f"no such outcome: {outcome}")
            board.pages.cut = (board.pages.operations + operation, outcome)
        elif order == "power":
            board.power_on()
            on = True
        elif order == "stack":
            board.core.wanted_sp = value
        elif order == "edges":
            board.exti.drive(value)
        elif order == "flicker":
            board.scene.flicker = tuple(value)
        elif order == "rate":
            board.usart.other_end = value
        elif order == "jump":
            board.core.wanted_pc = value | 1
        else:
            raise SystemExit(f"no such order: {order}")
        causes = [cause for cause, _ in board.resets[reported:]]
        reported = len(board.resets)
        report = {
            "sent": board.take_sent().hex(),
            "on": on,
            "resets": causes,
            "operations": board.pages.operations,
            "instructions": board.core.instructions,
            "stack": board.stack(),
            "time_s": board.core.now / HZ,
            "clock_zero_s": (board.timer.start or 0) / HZ,
            "rate": board.usart.rate(),
            "rom": board.core.in_rom,
            "pulls": {f"PA{pin}": board.ports["A"].pull(pin) for pin in (10, 11, 15)},
        }
        print(json.dumps(report), file=answers, flush=True)
