"""Every message and fact that leaves a process, declared once; imports nothing of ``app``.

Processes build these frozen dataclasses, pickle them to each other and write them to sockets; REST
answers with them, and the page's types are made from them (``app.contract.schema``). Nothing here
is checked when it is built: what comes from outside is checked where it comes in.
"""
