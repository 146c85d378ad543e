"""Every message and fact that leaves a process, declared once; imports nothing of ``app``.

Processes build these frozen dataclasses, pickle them to each other and write them to sockets; REST
answers with them, and the page's types are made from them (``tools.packaging.page_types``). Nothing
here is validated when it is built: outside input is validated where it enters.
"""
