"""Mass of the rod or thread: the pendulum swings faster than a point mass on a massless thread.

Formula: omega^2 = (g/L) (m + M/2)/(m + M/3)

M is the mass of the rod or thread, m that of the bob, L the length.

Parameters:
- `mass_per_length` [kg/m], 0 to 0.05, typically 1e-05: of the rod or thread

Source: compound pendulum; Landau & Lifshitz 1976
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="rod_mass",
    title="rod or thread mass",
    kind="physical",
    rigs=("pendulum", "double"),
    parameters=(Parameter("mass_per_length", "kg/m", 0.0, 0.05, 1e-5, meaning="of the rod or thread"),),
    equation="omega^2 = (g/L) (m + M/2)/(m + M/3)",
    source="compound pendulum; Landau & Lifshitz 1976",
    synonyms=("string mass", "thread mass", "massive rod", "massive thread", "rod inertia", "heavy string"),
    geometry="rod_mass",
    splits="weigh the thread, or swap the bob for a heavier one: the period then moves towards the ideal one",
)
