"""The local web page on which a person sees what was measured in a lab and corrects it.

- `serve.py`: start the server, print its address, end it
- `guard.py`: who may ask: token, Host, Origin
- `application.py`: what is answered at which address
- `described.py`: the lab and its measurements as JSON
- `compared.py`: what the last `compare` found
- `frames.py`: pictures of clips and photos, kept and decoded ahead
- `remeasure.py`: measurements in the background, each done once for the same settings
- `twin_in_step.py`: the twin of a film in the pixels and frames of its film
- `static/`: the page itself, plain HTML, CSS and JavaScript modules
"""
