"""What trains and wayside sites sent: kept durably, asked, learned from."""
