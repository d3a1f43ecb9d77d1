"""Tables of other programs as text: encodings, workbooks, what separates cells, and the numbers in them."""
