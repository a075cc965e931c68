"""The page's scene in a browser without a graphics processor: how fast it draws, and the pictures of the README."""
