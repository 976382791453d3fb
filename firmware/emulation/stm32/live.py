"""The board's serial line on a TCP connection or a pseudoterminal, for programs that take it for a board.

On a connection time goes as fast as this machine can, and bytes that arrive are received when they are
there. On a pseudoterminal it keeps pace with the wall, where this machine is quick enough.
"""

import os
import select
import socket
import sys
import time
import tty

#: How much time passes between two looks at the connection, in s.
STEP = 0.002


def serve(board, host, port):
    with socket.create_connection((host, port)) as line:
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while True:
            while select.select([line], [], [], 0)[0]:
                received = line.recv(4096)
                if not received:
                    return
                board.usart.receive(received, board.core.now)
            board.run(STEP)
            sent = board.take_sent()
            if sent:
                line.sendall(sent)


def serve_pty(board):
    line, other_end = os.openpty()
    tty.setraw(other_end)
    os.set_blocking(line, False)
    port = os.ttyname(other_end)
    print(f"the modelled board is on {port}")
    print(f"ask it:     shellcal board {port} identify")
    print(f"record it:  shellcal record {port} --start --duration 10 --output log.csv")
    print("Ctrl-C ends it")
    sys.stdout.flush()
    due, waiting = time.monotonic(), b""
    while True:
        try:
            board.usart.receive(os.read(line, 4096), board.core.now)
        except BlockingIOError:
            pass
        board.run(STEP)
        waiting += board.take_sent()
        # What nobody reads holds the board up, as its radio does.
        board.cts = "high" if len(waiting) > 4096 else "low"
        try:
            waiting = waiting[os.write(line, waiting) :]
        except BlockingIOError:
            pass
        due = max(due + STEP, time.monotonic() - 1)
        time.sleep(max(due - time.monotonic(), 0))
