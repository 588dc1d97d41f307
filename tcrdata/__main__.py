"""`python -m tcrdata`."""

from tcrdata.cli import main

if __name__ == "__main__":
    main()
