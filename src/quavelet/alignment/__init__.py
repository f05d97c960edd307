"""The first attitude: from two vectors, from gravity's apparent motion, from the turning earth."""
