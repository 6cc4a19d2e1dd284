"""Sources and sinks: what is added to a field and what decays, by half steps around the transport.

In: a `Source` and a rate of decay, functions of space and time.
Out: `Reaction`: the moments before and after the transport of a step, with their derivatives.
Start: `reaction`; its factors are made in `decay`, `wall_data` makes inflow data agree with it.
"""
