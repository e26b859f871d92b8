"""Choice between effects, and what the choice leaves unexplained.

- `locate`: regions of the motion where the mean residual is significant.
- `candidate`: a set of effects with its fit, its gain and the reason for its refusal.
- `name_effects`: forward selection over the library of effects.
- `complexity_penalty`: the gain that a further effect must reach.
- `bent_laws`: test whether a further effect is needed if the law of the first is only approximate.
- `formula`: formulas for disagreements that no listed effect explains.
- `gap`: size of the disagreement before and after, on all data and on held-out data.
- `stability`: how often other draws of the repetitions give the same name.
- `next_experiment`: settings that would separate rival effects.
"""
