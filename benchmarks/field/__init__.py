"""What people in the field record: inputs that are wrong in one way each, with the right answer."""
