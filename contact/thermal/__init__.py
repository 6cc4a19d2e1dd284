"""Thermal contact: heat conduction in the bodies and through their contact, and its expansion.

In: a contact problem, conductivities, the conductance of the contact, thermal conditions.
Out: `ThermalResult`: temperatures, heat fluxes, the contact under them; the balance of heat.
Start: `ThermalContact` in `thermal_contact`; `heat_system` has the equations of heat, `film` the
heat that passes a contact, `conduction` the forms of a body.
"""
