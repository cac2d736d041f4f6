"""A scene file: read, changed, and rendered.

============  ==========================================================================
``graph``     the file as a graph of nodes, before any Mitsuba object exists
``exchange``  Mitsuba's rough materials exchanged for ours, and back
``variants``  which variants of Mitsuba run on this machine
``render``    rendering in passes, with progress and an estimate of the noise
============  ==========================================================================
"""
