"""What every long work needs: RUN folder, journal of runs, seeds, progress, stopwatch, provenance."""
