"""Boards that cameras are calibrated with: printed, found in images, and where to hold them next.

``detection`` finds a board in an image and ``corners`` refines what it found; ``collecting`` keeps
the useful views of two live cameras, by what ``coverage`` lacks and ``guidance`` advises;
``board_images`` finds it in pairs of image files.
"""
