"""Runs an image: `python -m stm32 IMAGE`, with orders on standard input, or a serial line."""

import argparse
import sys

from .board import Board
from .boards import BOARDS
from .live import serve, serve_pty
from .orders import obey


def main():
    parser = argparse.ArgumentParser(prog="stm32", description=__doc__)
    parser.add_argument("image", help="ELF file, as it is flashed")
    parser.add_argument("--board", choices=BOARDS, default="skinproc", help="which the image is for")
    parser.add_argument("--script", help="codes that the converter gives, u16 little-endian: dark"
                        " and lit code of eight channels for each frame")
    parser.add_argument("--connect", metavar="HOST:PORT", help="serial line over TCP, in place of"
                        " orders on standard input")
    parser.add_argument("--pty", action="store_true", help="serial line on a pseudoterminal, at the"
                        " pace of the wall, in place of orders on standard input")
    args = parser.parse_args()
    script = b""
    if args.script:
        with open(args.script, "rb") as file:
            script = file.read()
    board = Board(args.image, BOARDS[args.board], script)
    try:
        if args.connect:
            host, port = args.connect.rsplit(":", 1)
            serve(board, host, int(port))
        elif args.pty:
            serve_pty(board)
        else:
            obey(board, sys.stdin, sys.stdout)
    except (BrokenPipeError, ConnectionError, KeyboardInterrupt):
        pass  # the client has gone


if __name__ == "__main__":
    main()
