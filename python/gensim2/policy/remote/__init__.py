"""Controllers on another machine, over websocket and msgpack, with a token and limits on size and time."""
