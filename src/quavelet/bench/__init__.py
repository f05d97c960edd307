"""At the bench: is this board good?"""
