"""The solution of a contact problem, with its certificate.

Input: the discrete problem (`ContactSystem`) with displacement and forces.
Output: `ContactResult`: residuals, tractions, status, stresses; the same from a file.
Start: `contact_system` for the residuals, `contact_result` for pressure, gap, status and files,
`body_result` for stresses and balance.
"""
