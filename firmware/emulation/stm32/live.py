"""The board's serial line as a TCP connection or a pseudoterminal, for programs that expect a board.

With TCP, time runs as fast as the host allows, and bytes are received when they arrive. A pseudoterminal runs in
real time if the host is fast enough.
"""

import os
import select
import socket
import sys
import time
import tty

#: Simulated time between two polls of the connection, in s.
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
        # Unread output holds up the board, as its radio would.
        board.cts = "high" if len(waiting) > 4096 else "low"
        try:
            waiting = waiting[os.write(line, waiting) :]
        except BlockingIOError:
            pass
        due = max(due + STEP, time.monotonic() - 1)
        time.sleep(max(due - time.monotonic(), 0))
