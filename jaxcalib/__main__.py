"""`python -m jaxcalib` is `jaxcalib`."""

from jaxcalib.cli.app import main

if __name__ == "__main__":
    main()
