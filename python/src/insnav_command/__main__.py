"""``python -m insnav_command`` is the command ``insnav``."""

from insnav_command import main

if __name__ == "__main__":
    main()
