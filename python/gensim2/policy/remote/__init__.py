"""Run a controller on another machine, over a websocket with msgpack messages, a token, and size and time limits."""
