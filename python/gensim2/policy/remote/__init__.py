"""A controller on another machine: websocket and msgpack, a token, caps on size and time, and no pickle."""
