"""The steps of the bench session, one file each: what is asked of the person, and when it is enough."""
