"""Where the base can stand and how far it is from there: free floor, geodesic fields, poses."""
