"""Rates and gravity to attitude: the quaternion kernel and the filters around it."""
