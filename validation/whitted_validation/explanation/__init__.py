"""One pixel explained: its ray tree in both programs, in words, numbers and drawings.

explanation   `explain` and what it returns
comparison    values of both programs side by side, and where their decisions part
reference_side  the reference's ray tree in the plugin's own records
closeness     how nearly decisions fell otherwise
story         why the pixel has its colour, in words
tree          the ray tree as headed lists; `terminal` and `page` show it
outlines, drawing   the scene from above and from the side
"""
