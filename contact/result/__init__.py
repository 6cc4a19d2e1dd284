"""The solution of a contact problem, with its certificate.

In: the discrete problem (`ContactSystem`) with displacement and forces.
Out: `ContactResult`: residuals, tractions, status, stresses; the same from a file.
Start: `contact_system` for the residuals, `contact_result` for pressure, gap, status and files,
`body_result` for stresses and balance.
"""
