"""The board's serial line on a TCP connection, for programs that take it for a board.

Time does not keep pace with the wall: it goes as fast as this machine can, and bytes that arrive
are received when they are there.
"""

import select
import socket

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
