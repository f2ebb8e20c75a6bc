"""Run a controller on another machine: client and server exchange msgpack messages over a websocket.

The server accepts only clients that send its token. The size of messages and the time for sending them are limited.
"""
