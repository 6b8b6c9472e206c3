"""`python -m agents.export linear-blind --out DIR`."""

from agents.export.check import main

if __name__ == "__main__":
    main()
