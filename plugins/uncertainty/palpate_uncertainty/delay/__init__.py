"""The delay of the force, judged: what it does to an estimate, and what a record shows of it.

`timing_shift` and `late_force` say what an unknown delay does to the parameters; `delay_from_motion` estimates it from
a rich motion (`timed_record` is such a record), `passivity` finds it without a contact model, and `one_frequency` says
where it cannot be distinguished from a viscosity.
"""
