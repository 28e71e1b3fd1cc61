"""`python -m jaxcalib` is `jaxcalib`."""

from jaxcalib.cli import main

if __name__ == "__main__":
    main()
