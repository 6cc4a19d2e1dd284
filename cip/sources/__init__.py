"""Sources and sinks: what is added to a field and what decays, by half steps around the transport.

In: a source and a rate of decay, functions of space and time.
Out: `HalfStep`: the moments before and after the transport of a step, with their derivatives.
Start: `reaction`, whose `HalfStep` acts before and after the transport.
"""
