"""Sources and sinks: source and decay terms, in half steps before and after the transport.

In: a source and a rate of decay, functions of space and time.
Out: `HalfStep`: the moments before and after the transport of a step, with their derivatives.
Start: `reaction`, whose `HalfStep` acts before and after the transport.
"""
