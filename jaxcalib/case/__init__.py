"""A case: the folder that ties a SUMO scenario to the logs of drives on that road."""
