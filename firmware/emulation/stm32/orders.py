"""Orders of a test as JSON objects, one per line, with a report on each.

| order | effect |
|---|---|
| {"run": s} | lets time pass |
| {"send": hex} | sends bytes on the serial line to the board at its rate |
| {"cts": "low" / "high" / "open"} | sets CTS: clear to send, held up, not connected |
| {"converter": false} | conversions no longer end |
| {"cut": [n, outcome]} | cuts the power at the n-th flash operation from now |
| {"power": true} | switches on again; the flash keeps its content |
| {"branch": true} | the next "leave" undoes all orders after this one |
| {"leave": true} | back to the state at "branch" |
| {"jump": address} | the core continues there, as after a damaged return address |
| {"stack": address} | sets the stack pointer, as deeply nested calls would |
| {"edges": [s, ...]} | the sync input rises after each of these times |
| {"flicker": [steps, hz]} | ambient light of this amplitude and frequency |
| {"rate": baud} | sets the rate of the other end; a mismatch of more than 4 % garbles the bytes |
"""

import json
import os

from .flash import OUTCOMES
from .peripheral import HZ


def obey(board, requests, answers):
    """Executes orders until the input ends."""
    on, reported = True, 0
    for line in requests:
        order, value = next(iter(json.loads(line).items()))
        if order == "branch":
            # The child process continues; the parent keeps the state and waits for the child's end.
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
