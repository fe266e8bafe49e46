"""Store and forward between a train (or wayside site) and the cloud."""
